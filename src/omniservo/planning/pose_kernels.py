"""Poses, twists and their change along a camera path (23), compiled."""

from __future__ import annotations

import numpy as np

from omniservo.estimation.rotation_parameters import matrix_from_quaternion
from omniservo.geometry.arrays import FloatArray
from omniservo.geometry.kernel import kernel, leaf


@kernel
def write_poses(rotation: FloatArray, translation: FloatArray, w: FloatArray, poses: FloatArray) -> None:
    """Write initial_T_camera (m, 4, 4) at w (m,): Λ(φ)/‖φ‖² and t, of a path given by powers."""
    phi = np.empty((3, 4))
    for k in range(w.shape[0]):
        _derive(rotation, w[k], phi)
        matrix_from_quaternion(phi[0, 0], phi[0, 1], phi[0, 2], phi[0, 3], poses[k, :3, :3])
        for i in range(3):
            poses[k, i, 3] = _value(translation, i, w[k], 0)
            poses[k, 3, i] = 0.0
        poses[k, 3, 3] = 1.0


@kernel
def write_twists(
    rotation: FloatArray, translation: FloatArray, w: FloatArray, order: int, twists: FloatArray
) -> None:
    """Write the camera's twist (m, 6) at w (m,), or of order 2 its derivative; see `CameraPath`."""
    phi, turn, t = np.empty((3, 4)), np.empty((3, 3)), np.empty((2, 3))
    for k in range(w.shape[0]):
        _derive(rotation, w[k], phi)
        matrix_from_quaternion(phi[0, 0], phi[0, 1], phi[0, 2], phi[0, 3], turn)
        for i in range(3):
            t[0, i], t[1, i] = _value(translation, i, w[k], 1), _value(translation, i, w[k], 2)
        square, growth = 0.0, 0.0
        for c in range(4):
            square += phi[0, c] * phi[0, c]
            growth += 2.0 * phi[0, c] * phi[1, c]
        v, o = np.empty(3), np.empty(3)
        for i in range(3):
            v[i] = turn[0, i] * t[0, 0] + turn[1, i] * t[0, 1] + turn[2, i] * t[0, 2]
            o[i] = 2.0 * _turned_back(phi[0], phi[1], i) / square
        for i in range(3):
            j, h = (i + 1) % 3, (i + 2) % 3
            if order == 1:
                twists[k, i], twists[k, 3 + i] = v[i], o[i]
            else:
                along = turn[0, i] * t[1, 0] + turn[1, i] * t[1, 1] + turn[2, i] * t[1, 2]
                twists[k, i] = along - (o[j] * v[h] - o[h] * v[j])
                twists[k, 3 + i] = (2.0 * _turned_back(phi[0], phi[2], i) - growth * o[i]) / square


@leaf
def _derive(rotation: FloatArray, w: float, phi: FloatArray) -> None:
    for order in range(3):
        for c in range(4):
            phi[order, c] = _value(rotation, c, w, order)


@leaf
def _value(coefficients: FloatArray, row: int, w: float, order: int) -> float:
    """Return the derivative of this order of the polynomial in a row, highest power first, by Horner."""
    n, value = coefficients.shape[1] - 1, 0.0
    for k in range(n + 1 - order):
        factor = 1.0
        for d in range(order):
            factor *= n - k - d
        value = value * w + factor * coefficients[row, k]
    return value


@leaf
def _turned_back(p: FloatArray, q: FloatArray, i: int) -> float:
    """Return the i-th number of vec(p* ⊗ q) = p_w q_v − q_w p_v − p_v × q_v, (x, y, z, w) each."""
    j, h = (i + 1) % 3, (i + 2) % 3
    return float(p[3] * q[i] - q[3] * p[i] - (p[j] * q[h] - p[h] * q[j]))
