"""Pose and motion on a planned path, compiled for the control step."""

import math

import numpy as np

from omniservo.geometry.arrays import FloatArray
from omniservo.geometry.kernel import kernel, leaf


@kernel
def path_state(
    rotation: FloatArray, translation: FloatArray, w: float, pose: FloatArray, twist: FloatArray
) -> None:
    """Write pose (7,) and camera-frame twist (6,) per unit w of the path (23) at ``w``.

    φ, t by Horner from the power bases (4, σ+1), (3, τ+1), highest power first; the pose is φ/‖φ‖ and t.
    Linear: Rᵀ t′. Angular, from R′ = R [ω]×: ω = 2 vec(φ* ⊗ φ′)/‖φ‖², which the length of φ leaves alone.
    """
    q = np.empty(4)
    dq = np.empty(4)
    dt = np.empty(3)
    for i in range(4):
        q[i], dq[i] = _horner(rotation, i, w)
    for i in range(3):
        pose[4 + i], dt[i] = _horner(translation, i, w)
    square = q[0] * q[0] + q[1] * q[1] + q[2] * q[2] + q[3] * q[3]
    norm = math.sqrt(square)
    for i in range(4):
        pose[i] = q[i] / norm
    x, y, z, s = pose[0], pose[1], pose[2], pose[3]
    ax, ay, az = 2.0 * (dt[1] * z - dt[2] * y), 2.0 * (dt[2] * x - dt[0] * z), 2.0 * (dt[0] * y - dt[1] * x)
    twist[0] = dt[0] + s * ax + ay * z - az * y
    twist[1] = dt[1] + s * ay + az * x - ax * z
    twist[2] = dt[2] + s * az + ax * y - ay * x
    twist[3] = 2.0 * (q[3] * dq[0] - dq[3] * q[0] - (q[1] * dq[2] - q[2] * dq[1])) / square
    twist[4] = 2.0 * (q[3] * dq[1] - dq[3] * q[1] - (q[2] * dq[0] - q[0] * dq[2])) / square
    twist[5] = 2.0 * (q[3] * dq[2] - dq[3] * q[2] - (q[0] * dq[1] - q[1] * dq[0])) / square


@leaf
def _horner(coefficients: FloatArray, row: int, w: float) -> tuple[float, float]:
    """Return the polynomial in row ``row``, highest power first, and its derivative at ``w``."""
    value = 0.0
    slope = 0.0
    for k in range(coefficients.shape[1]):
        slope = slope * w + value
        value = value * w + coefficients[row, k]
    return value, slope
