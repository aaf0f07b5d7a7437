"""Where a flat board is, from its points in one image of a known camera, past 90° too."""

from __future__ import annotations

import numpy as np
from scipy.optimize import least_squares
from scipy.spatial.transform import RigidTransform, Rotation

from omniservo.cameras.models.central_model import CentralModel
from omniservo.geometry.arrays import FloatArray
from omniservo.geometry.nearest_rotation import nearest_rotation

_LEAST_POINTS = 6


def board_pose(camera: CentralModel, pixels: FloatArray, points: FloatArray) -> RigidTransform | None:
    """Return camera_T_board that minimises the reprojection error [px²]; None where it cannot be found.

    A bearing b sees the board's point (x, y, 0) along H (x, y, 1) with H = s (r₁, r₂, t): b × H(x, y, 1) = 0
    is linear in H, for bearings of any direction. Its solution starts the refinement.

    Args:
        camera: that took the image.
        pixels: (n, 2) [px].
        points: (n, 3) [m] on the board, z = 0.
    """
    bearings, valid = camera.unproject(pixels)
    if valid.sum() < _LEAST_POINTS:
        return None
    pixels, points, bearings = pixels[valid], points[valid], bearings[valid]
    start = _linear_pose(bearings, points)

    def residual(p: FloatArray) -> FloatArray:
        seen, ok = camera.project(Rotation.from_rotvec(p[:3]).apply(points) + p[3:])
        return np.asarray(np.where(ok[:, None], seen - pixels, 1e3).ravel())

    scale = float(np.linalg.norm(start[3:]))
    solution = least_squares(residual, start, x_scale=[1.0] * 3 + [max(scale, 1e-6)] * 3, method="lm")
    if not np.isfinite(solution.cost) or np.abs(solution.fun).max() >= 1e3:
        return None
    return RigidTransform.from_components(solution.x[3:], Rotation.from_rotvec(solution.x[:3]))


def _linear_pose(bearings: FloatArray, points: FloatArray) -> FloatArray:
    """Rotation vector and translation (6,) from b × H(x, y, 1) = 0."""
    middle, size = points[:, :2].mean(axis=0), float(np.abs(points[:, :2] - points[:, :2].mean(0)).max())
    flat = np.column_stack([(points[:, :2] - middle) / size, np.ones(len(points))])
    x, y, z = bearings.T[:, :, None] * flat
    zero = np.zeros_like(x)
    rows = np.concatenate([np.hstack([zero, -z, y]), np.hstack([z, zero, -x]), np.hstack([-y, x, zero])])
    H = np.linalg.svd(rows)[2][-1].reshape(3, 3)
    H *= np.sign(((flat @ H.T) * bearings).sum()) / (0.5 * np.linalg.norm(H[:, :2], axis=0).sum())
    R = nearest_rotation(np.column_stack([H[:, 0], H[:, 1], np.cross(H[:, 0], H[:, 1])]))
    translation = H[:, 2] * size - R[:, :2] @ middle
    return np.concatenate([Rotation.from_matrix(R).as_rotvec(), translation])
