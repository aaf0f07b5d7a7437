"""Where the adjustment begins: closed forms of three views at a time, and the one that most views agree with.

AX = XB: two views give A = (base_T_flange₂)⁻¹ base_T_flange₁ and B = camera_T_board₂ (camera_T_board₁)⁻¹.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import cv2
import numpy as np
from scipy.spatial.transform import RigidTransform

from omniservo.geometry.arrays import FloatArray, IntArray

_DRAWS = 120
_METHODS = (cv2.CALIB_HAND_EYE_PARK, cv2.CALIB_HAND_EYE_DANIILIDIS)


@dataclass(frozen=True, eq=False)
class HandEyeStart:
    """Both unknown poses, roughly."""

    flange_T_camera: RigidTransform
    base_T_board: RigidTransform
    chosen: IntArray
    """(n,) which of its poses each view has"""
    misfit: float
    """of the median view, whose board is off: angle [rad] plus length over the board's distance"""


def closed_form(base_T_flange: FloatArray, camera_T_board: FloatArray, method: int) -> FloatArray | None:
    """Return flange_T_camera (4, 4) of n views (n, 4, 4) each, by a method of OpenCV's; None where it fails.

    Park & Martin, IEEE T-RA 10(5), 1994, or dual quaternions: Daniilidis, IJRR 18(3), 1999.
    """
    A, B = base_T_flange, camera_T_board
    try:
        R, t = cv2.calibrateHandEye(
            list(A[:, :3, :3]), list(A[:, :3, 3]), list(B[:, :3, :3]), list(B[:, :3, 3]), method=method
        )
    except cv2.error:
        return None
    if not (np.isfinite(R).all() and np.isfinite(t).all()) or abs(np.linalg.det(R) - 1.0) > 1e-6:
        return None
    return np.block([[R, t], [np.zeros((1, 3)), np.ones((1, 1))]])


def start(base_T_flange: RigidTransform, poses: Sequence[Sequence[RigidTransform]]) -> HandEyeStart | None:
    """Return the closed form whose board stands still for most views; None where all fail.

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
    best: tuple[float, FloatArray, FloatArray, IntArray] | None = None
    for draw in range(_DRAWS):
        whole = draw < len(_METHODS)
        views = np.arange(len(A)) if whole else rng.choice(len(A), 3, replace=False)
        rows = firsts[views] + (0 if whole else rng.integers(counts[views]))
        X = closed_form(A[views], B[rows], _METHODS[draw % len(_METHODS)])
        if X is None:
            continue
        found = _judged(np.repeat(A, counts, axis=0) @ X @ B, rows, firsts, reach)
        if best is None or found[0] < best[0]:
            best = (found[0], X, *found[1:])
    if best is None:
        return None
    misfit, X, board, chosen = best
    return HandEyeStart(RigidTransform.from_matrix(X), RigidTransform.from_matrix(board), chosen, misfit)


def _judged(
    boards: FloatArray, rows: IntArray, firsts: IntArray, reach: float
) -> tuple[float, FloatArray, IntArray]:
    """Return misfit, board (4, 4) and chosen poses: the board is the mean of the drawn ``rows``."""
    middle = boards[rows].mean(axis=0)
    U, _, Vt = np.linalg.svd(middle[:3, :3])
    middle[:3, :3] = U @ np.diag([1.0, 1.0, np.linalg.det(U @ Vt)]) @ Vt
    turned = np.linalg.norm(boards[:, :3, :3] - middle[:3, :3], axis=(1, 2)) / np.sqrt(8.0)
    away = np.linalg.norm(boards[:, :3, 3] - middle[:3, 3], axis=1)
    misfits = 2.0 * np.arcsin(np.minimum(turned, 1.0)) + away / reach
    chosen = np.array([np.argmin(part) for part in np.split(misfits, firsts[1:])])
    return float(np.median(misfits[firsts + chosen])), middle, chosen
