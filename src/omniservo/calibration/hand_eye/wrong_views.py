"""Views that no error of the robot explains: another image's pose, a pose read while the arm moved."""

from __future__ import annotations

import math

import numpy as np
from scipy.special import fdtri

from omniservo.calibration.hand_eye.loop import LinearLoop
from omniservo.geometry.arrays import BoolArray, FloatArray

_ROUNDS = 20
_HEAVY = 4.0
"""degrees of freedom of Student's law"""

_MEDIAN_LENGTH = 1.538
"""of a vector of three standard normal numbers"""

_CHANCE = 1e-4
"""that a view which is not wrong is called so"""


def robust_step(linear: LinearLoop) -> tuple[FloatArray, BoolArray]:
    """Return the step (12,) that most views agree with, and which views (n,) are wrong beside the median one.

    Generalised least squares with weights of Student's law, (ν + 6)/(ν + rᵀV⁻¹r); the robot's (σ_t, σ_r) in V
    are the median lengths of the views' r.
    """
    n = len(linear.q)
    taken_up = math.sqrt(n / max(n - 2.0, 1.0))
    step = np.zeros(12)
    for _ in range(_ROUNDS):
        left = linear.q - linear.M @ step
        lengths = np.linalg.norm(left.reshape(n, 2, 3), axis=2)
        sigmas = taken_up * np.median(lengths, axis=0) / _MEDIAN_LENGTH
        V_inverse = np.linalg.inv(linear.C + np.diag(np.repeat(sigmas**2, 3)))
        distances = np.einsum("ni,nij,nj->n", left, V_inverse, left)
        weights = (_HEAVY + 6.0) / (_HEAVY + distances)
        MV = weights[:, None, None] * np.swapaxes(linear.M, 1, 2) @ V_inverse
        normal, right = (MV @ linear.M).sum(axis=0), np.einsum("nij,nj->i", MV, linear.q)
        scale = 1.0 / np.sqrt(np.diag(normal))
        step = scale * np.linalg.lstsq(normal * scale * scale[:, None], scale * right, rcond=1e-13)[0]
    return step, distances > 6.0 * fdtri(6, 3 * n - 6, 1.0 - _CHANCE)
