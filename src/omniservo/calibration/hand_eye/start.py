"""Where the adjustment begins: closed forms of three views at a time, and the one that most views agree with.

AX = XB: two views give A = (base_T_flange₂)⁻¹ base_T_flange₁ and B = camera_T_board₂ (camera_T_board₁)⁻¹.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.spatial.transform import RigidTransform, Rotation

from omniservo.geometry.arrays import FloatArray, IntArray
from omniservo.geometry.nearest_rotation import nearest_rotation

_DRAWS = 120


@dataclass(frozen=True, eq=False)
class HandEyeStart:
    """Both unknown poses, roughly."""

    flange_T_camera: RigidTransform
    base_T_board: RigidTransform
    chosen: IntArray
    """(n,) which of its poses each view has"""
    misfit: float
    """of the median view, whose board is off: angle [rad] plus length over the board's distance"""


def closed_form(base_T_flange: FloatArray, camera_T_board: FloatArray) -> FloatArray:
    """Return flange_T_camera (..., 4, 4) of n views (..., n, 4, 4) each.

    The rotation turns the rotation vectors of all B onto those of all A, the translation solves
    (R_A − I) t = R t_B − t_A, both by least squares: Park & Martin, IEEE T-RA 10(5), 1994. (OpenCV's
    calibrateHandEye does the same for one set of views; OpenCV 5.0 has it not.) Where all rotations have one
    axis, some camera of those that fit is returned.
    """
    i, j = np.triu_indices(base_T_flange.shape[-3], k=1)
    A = np.linalg.inv(base_T_flange[..., j, :, :]) @ base_T_flange[..., i, :, :]
    B = camera_T_board[..., j, :, :] @ np.linalg.inv(camera_T_board[..., i, :, :])
    R = nearest_rotation(np.swapaxes(_rotation_vectors(A), -1, -2) @ _rotation_vectors(B))
    turned = (A[..., :3, :3] - np.eye(3)).reshape(*A.shape[:-3], -1, 3)
    moved = (R[..., None, :, :] @ B[..., :3, 3:] - A[..., :3, 3:]).reshape(*A.shape[:-3], -1, 1)
    X = np.broadcast_to(np.eye(4), (*A.shape[:-3], 4, 4)).copy()
    X[..., :3, :3] = R
    X[..., :3, 3:] = np.linalg.pinv(turned) @ moved
    return X


def start(base_T_flange: RigidTransform, poses: Sequence[Sequence[RigidTransform]]) -> HandEyeStart:
    """Return the closed form whose board stands still for most views.

    Args:
        base_T_flange: n poses.
        poses: of each view camera_T_board, all that its corners leave open.
    """
    rng = np.random.default_rng(0)
    A = base_T_flange.as_matrix()
    B = np.stack([pose.as_matrix() for own in poses for pose in own])
    counts = np.array([len(own) for own in poses])
    firsts = np.cumsum(counts) - counts
    reach = max(float(np.median(np.linalg.norm(B[:, :3, 3], axis=1))), 1e-9)
    views = np.stack([rng.choice(len(A), 3, replace=False) for _ in range(_DRAWS)])
    rows = firsts[views] + rng.integers(counts[views])
    starts = np.concatenate([closed_form(A, B[firsts])[None], closed_form(A[views], B[rows])])
    drawn = [firsts, *rows]
    carried = np.repeat(A, counts, axis=0)
    judged = [_judged(carried @ X @ B, at, firsts, reach) for X, at in zip(starts, drawn, strict=True)]
    best = min(range(len(judged)), key=lambda k: judged[k][0])
    misfit, board, chosen = judged[best]
    return HandEyeStart(
        RigidTransform.from_matrix(starts[best]), RigidTransform.from_matrix(board), chosen, misfit
    )


def _rotation_vectors(motions: FloatArray) -> FloatArray:
    """Return the rotation vectors (..., 3) [rad] of poses (..., 4, 4)."""
    vectors = Rotation.from_matrix(motions[..., :3, :3].reshape(-1, 3, 3)).as_rotvec()
    return np.asarray(vectors.reshape(*motions.shape[:-2], 3))


def _judged(
    boards: FloatArray, rows: IntArray, firsts: IntArray, reach: float
) -> tuple[float, FloatArray, IntArray]:
    """Return misfit, board (4, 4) and chosen poses: the board is the mean of the drawn ``rows``."""
    middle = boards[rows].mean(axis=0)
    middle[:3, :3] = nearest_rotation(middle[:3, :3])
    turned = np.linalg.norm(boards[:, :3, :3] - middle[:3, :3], axis=(1, 2)) / np.sqrt(8.0)
    away = np.linalg.norm(boards[:, :3, 3] - middle[:3, 3], axis=1)
    misfits = 2.0 * np.arcsin(np.minimum(turned, 1.0)) + away / reach
    chosen = np.array([np.argmin(part) for part in np.split(misfits, firsts[1:])])
    return float(np.median(misfits[firsts + chosen])), middle, chosen
