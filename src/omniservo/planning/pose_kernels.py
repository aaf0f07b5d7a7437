"""Poses, twists and their change along a camera path (23), compiled."""

from __future__ import annotations

import numpy as np

from omniservo.geometry.arrays import FloatArray
from omniservo.geometry.kernel import kernel, leaf
from omniservo.geometry.quaternions import matrix_from_quaternion


@kernel
def write_states(
    rotation: FloatArray, translation: FloatArray, w: FloatArray, poses: FloatArray, motions: FloatArray
) -> None:
    """Write pose and motion of a path given by powers at w (m,); see `CameraPath`.

    Args:
        rotation: φ (4, σ+1), highest power first.
        translation: t (3, τ+1) [m].
        w: (m,)
        poses: (m, 4, 4) out: initial_T_camera, Λ(φ)/‖φ‖² and t.
        motions: (m, 2, 6) out: the camera's twist and its derivative.
    """
    phi, t, turn = np.empty((3, 4)), np.empty((3, 3)), np.empty((3, 3))
    for k in range(w.shape[0]):
        for c in range(4):
            _derive(rotation, c, w[k], phi)
        for i in range(3):
            _derive(translation, i, w[k], t)
        matrix_from_quaternion(phi[0, 0], phi[0, 1], phi[0, 2], phi[0, 3], turn)
        for i in range(3):
            for j in range(3):
                poses[k, i, j] = turn[i, j]
            poses[k, i, 3], poses[k, 3, i] = t[0, i], 0.0
        poses[k, 3, 3] = 1.0
        _write_motion(phi, turn, t, motions[k])


@kernel
def powers_along(coefficients: FloatArray, begin: float, step: float) -> FloatArray:
    """Return the powers of p(begin + step·s), highest first, of polynomials (m, n+1) likewise, by Horner."""
    m, n = coefficients.shape
    found = np.zeros((m, n))
    for r in range(m):
        for k in range(n):
            for c in range(n - 1 - k, n - 1):
                found[r, c] = step * found[r, c + 1] + begin * found[r, c]
            found[r, n - 1] = begin * found[r, n - 1] + coefficients[r, k]
    return found


@leaf
def _write_motion(phi: FloatArray, turn: FloatArray, t: FloatArray, motion: FloatArray) -> None:
    """Write twist and derivative (2, 6) from φ (3, 4) and t (3, 3), each with two derivatives, and Λ/‖φ‖²."""
    square, growth = 0.0, 0.0
    for c in range(4):
        square += phi[0, c] * phi[0, c]
        growth += 2.0 * phi[0, c] * phi[1, c]
    for i in range(3):
        motion[0, i] = turn[0, i] * t[1, 0] + turn[1, i] * t[1, 1] + turn[2, i] * t[1, 2]
        motion[0, 3 + i] = 2.0 * _turned_back(phi, 1, i) / square
    for i in range(3):
        j, h = (i + 1) % 3, (i + 2) % 3
        along = turn[0, i] * t[2, 0] + turn[1, i] * t[2, 1] + turn[2, i] * t[2, 2]
        across = motion[0, 3 + j] * motion[0, h] - motion[0, 3 + h] * motion[0, j]
        motion[1, i] = along - across
        motion[1, 3 + i] = (2.0 * _turned_back(phi, 2, i) - growth * motion[0, 3 + i]) / square


@leaf
def _derive(coefficients: FloatArray, row: int, w: float, found: FloatArray) -> None:
    """Write a row's polynomial, highest power first, and two derivatives into its column of (3, …)."""
    value, slope, half = 0.0, 0.0, 0.0
    for k in range(coefficients.shape[1]):
        half = half * w + slope
        slope = slope * w + value
        value = value * w + coefficients[row, k]
    found[0, row], found[1, row], found[2, row] = value, slope, 2.0 * half


@leaf
def _turned_back(phi: FloatArray, order: int, i: int) -> float:
    """Return the i-th number of vec(p* ⊗ q) = p_w q_v − q_w p_v − p_v × q_v, p = φ, q a derivative."""
    j, h = (i + 1) % 3, (i + 2) % 3
    across = phi[0, j] * phi[order, h] - phi[0, h] * phi[order, j]
    return float(phi[0, 3] * phi[order, i] - phi[order, 3] * phi[0, i] - across)
