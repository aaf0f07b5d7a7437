"""Where the servo leads the camera when the points are not where the plan has them."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from omniservo.cameras import UnifiedCamera
from omniservo.estimation.uncertainty.calibration_response import pixel_slopes
from omniservo.geometry.arrays import FloatArray
from omniservo.planning.camera_path import CameraPath


class ServoResponse(NamedTuple):
    """Planned poses and what the servo makes of bearings that differ from the planned ones.

    The servo keeps the bearings s of the points it sees on the planned ones, s_p(w), in the least-squares
    sense: it rests where Jᵀ(s − s_p) = 0, J the derivative of the bearings by the camera's twist. From the
    planned pose that is a move of −J⁺(s − s_p).
    """

    places: FloatArray
    """(W,) w"""
    quaternions: FloatArray
    """(W, 4) planned, (x, y, z, w)"""
    rotations: FloatArray
    """(W, 3, 3) the same"""
    translations: FloatArray
    """(W, 3) planned [m]"""
    planned: FloatArray
    """(W, n, 3) planned bearings s_p"""
    inverse: FloatArray
    """(W, 6, 3n) J⁺: bearings to twist (linear [m], angular [rad]) in the camera frame"""
    lens: FloatArray
    """(W, n, 3, p) ∂s/∂θ at a fixed point: what the camera takes a point's bearing for when its parameters
    are off by dθ"""


def servo_response(
    camera: UnifiedCamera, points: FloatArray, path: CameraPath, places: FloatArray, parameters: int
) -> ServoResponse:
    """Return the response at ``places`` (W,) for points (n, 3) and so many uncertain camera parameters."""
    poses = path(places)
    turns, centres = poses.rotation, poses.translation
    rotations = turns.as_matrix()
    seen = np.einsum("wji,wnj->wni", rotations, points[None] - centres[:, None])
    distances = np.linalg.norm(seen, axis=2, keepdims=True)
    bearings = seen / distances
    n = len(points)
    across = np.eye(3) - bearings[..., :, None] * bearings[..., None, :]
    by_twist = np.concatenate((-across / distances[..., None], _cross_matrices(bearings)), axis=3)
    J = by_twist.reshape(len(places), 3 * n, 6)
    inverse = np.linalg.pinv(J)
    lens = np.zeros((len(places), n, 3, parameters))
    if parameters:
        _, slopes, valid = camera.project_jacobian(seen)
        answers = np.linalg.pinv(np.where(valid[..., None, None], slopes, 0.0)) / distances[..., None]
        lens = answers @ pixel_slopes(camera, seen, parameters)
    return ServoResponse(
        np.ascontiguousarray(places),
        np.ascontiguousarray(turns.as_quat()),
        np.ascontiguousarray(rotations),
        np.ascontiguousarray(centres),
        np.ascontiguousarray(bearings),
        np.ascontiguousarray(inverse),
        np.ascontiguousarray(lens),
    )


def _cross_matrices(vectors: FloatArray) -> FloatArray:
    """Return [v]× (…, 3, 3) of vectors (…, 3)."""
    x, y, z = np.moveaxis(vectors, -1, 0)
    zero = np.zeros_like(x)
    rows = ((zero, -z, y), (z, zero, -x), (-y, x, zero))
    return np.stack([np.stack(row, axis=-1) for row in rows], axis=-2)
