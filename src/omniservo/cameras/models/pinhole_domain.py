"""Where OpenCV's distortion stays one-to-one, and the numbers that its inverse starts from."""

from __future__ import annotations

import math
from functools import lru_cache

import numpy as np
from scipy.spatial.transform import Rotation

from omniservo.cameras.distortion import largest_invertible_radius
from omniservo.cameras.models.polynomial_domain import first_positive_root, inverse_table
from omniservo.cameras.models.radial_kernels import TABLE
from omniservo.geometry.arrays import FloatArray

_SHORT_OF_THE_END = 1.0 - 1e-6
_LARGEST_DISTORTED = 1e3
"""‖m‖ that is checked where there is distortion: 89.94° from the axis"""
_ANGLES, _AT_ONCE = 2000, 50
_DIRECTIONS = 180


def tilt_matrix(tau_x: float, tau_y: float) -> FloatArray:
    """Return the homography (3, 3) of a tilted sensor: [[R₃₃, 0, −R₁₃], [0, R₃₃, −R₂₃], [0, 0, 1]] R.

    R turns by τx about x, then by τy about y (Louhichi et al. 2007, OpenCV's calib3d), with OpenCV's
    signs: R = R_y(τy) R_x(τx) with the transposes of the usual elementary rotations.
    """
    R = Rotation.from_euler("xy", [-tau_x, -tau_y]).as_matrix()
    projection = np.array([[R[2, 2], 0.0, -R[0, 2]], [0.0, R[2, 2], -R[1, 2]], [0.0, 0.0, 1.0]])
    return np.asarray(projection @ R)


@lru_cache(maxsize=64)  # a camera is made again of the same lens whenever another of its fields changes
def largest_disc(distortion: tuple[float, ...], sensor: tuple[float, ...]) -> float:
    """Return the radius of the largest disc in which D is one-to-one and its image in front of the sensor.

    That holds on a disc on which the symmetric part of D's Jacobian is positive definite. With k1, k2,
    p1, p2 alone the radius is known in closed form; else the smallest eigenvalue is followed outwards in 180
    directions, in steps of 0.045° from the axis, and the end halved down to the last digit.

    Args:
        distortion: (14,) in OpenCV's order.
        sensor: (3,) what has to be positive for (D(m), 1): the tilted sensor's last row over its last number.
    """
    coefficients = np.array(distortion)
    if not coefficients.any():
        return math.inf
    k1, k2, p1, p2, *others = distortion
    if not any(others):
        return min(largest_invertible_radius((k1, k2, p1, p2)), _LARGEST_DISTORTED)
    pole = first_positive_root([1.0, *coefficients[5:8]])
    end = min(_LARGEST_DISTORTED, math.sqrt(pole) * _SHORT_OF_THE_END)
    radii = np.tan(np.linspace(0.0, math.atan(end), _ANGLES))
    for begin in range(0, _ANGLES, _AT_ONCE):
        bad = _worst(coefficients, sensor, radii[begin : begin + _AT_ONCE]) <= 0.0
        if bad.any():
            break
    else:
        return end * _SHORT_OF_THE_END
    first = begin + int(np.argmax(bad))
    low, high = radii[first - 1], radii[first]
    for _ in range(60):
        half = 0.5 * (low + high)
        low, high = (low, half) if _worst(coefficients, sensor, np.array([half]))[0] <= 0.0 else (half, high)
    return float(low) * _SHORT_OF_THE_END


def largest_reach(coefficients: FloatArray, disc: float) -> float:
    """Return an upper bound of ‖D(m)‖ over the disc: twice the largest on its rim, where it is largest."""
    m = disc * _rays()
    return 2.0 * float(np.hypot(*_distorted(coefficients, m).T).max())


def radial_table(coefficients: FloatArray, disc: float, farthest: float) -> tuple[FloatArray, float]:
    """Return radii at equal steps of the distortion's radial part, as `inverse_table` does, and 1/step.

    The radial part grows over the disc: its slope is the Jacobian's mean over m and −m. The table ends at the
    disc or 20% beyond ``farthest``, what the image needs.
    """

    def radial(r: FloatArray) -> FloatArray:
        return np.asarray(r * _radial(coefficients, r * r))

    low, end = 0.0, disc
    if radial(np.array(disc)) > 1.2 * farthest:
        for _ in range(60):
            half = 0.5 * (low + end)
            low, end = (low, half) if radial(np.array(half)) > 1.2 * farthest else (half, end)
    return inverse_table(radial, end, TABLE), TABLE / float(radial(np.array(end)))


def _rays() -> FloatArray:
    around = np.linspace(0.0, 2.0 * math.pi, _DIRECTIONS, endpoint=False)
    return np.column_stack([np.cos(around), np.sin(around)])


def _radial(c: FloatArray, r2: FloatArray) -> FloatArray:
    k1, k2, _, _, k3, k4, k5, k6, *_ = c
    return np.asarray((1.0 + r2 * (k1 + r2 * (k2 + r2 * k3))) / (1.0 + r2 * (k4 + r2 * (k5 + r2 * k6))))


def _distorted(c: FloatArray, m: FloatArray) -> FloatArray:
    x, y = m[..., 0], m[..., 1]
    _, _, p1, p2, _, _, _, _, s1, s2, s3, s4, *_ = c
    r2 = x * x + y * y
    factor = _radial(c, r2) + 2.0 * (p2 * x + p1 * y)
    return np.stack([x * factor + r2 * (p2 + s1 + r2 * s2), y * factor + r2 * (p1 + s3 + r2 * s4)], axis=-1)


def _worst(c: FloatArray, sensor: tuple[float, ...], radii: FloatArray) -> FloatArray:
    """Return, for each radius, the least of the eigenvalue and the sensor's distance over all directions."""
    m = radii[:, None, None] * _rays()
    x, y = m[..., 0], m[..., 1]
    k1, k2, p1, p2, k3, k4, k5, k6, s1, s2, s3, s4, *_ = c
    r2 = x * x + y * y
    above = 1.0 + r2 * (k1 + r2 * (k2 + r2 * k3))
    below = 1.0 + r2 * (k4 + r2 * (k5 + r2 * k6))
    radial = above / below
    up, down = k1 + r2 * (2.0 * k2 + 3.0 * r2 * k3), k4 + r2 * (2.0 * k5 + 3.0 * r2 * k6)
    slope = 2.0 * (up - radial * down) / below
    factor = radial + 2.0 * (p2 * x + p1 * y)
    px, py = 2.0 * (p2 + s1 + 2.0 * r2 * s2), 2.0 * (p1 + s3 + 2.0 * r2 * s4)
    xx = factor + x * (slope * x + 2.0 * p2) + px * x
    yy = factor + y * (slope * y + 2.0 * p1) + py * y
    xy = 0.5 * (x * (slope * y + 2.0 * p1) + px * y + y * (slope * x + 2.0 * p2) + py * x)
    least = 0.5 * (xx + yy) - np.hypot(0.5 * (xx - yy), xy)
    d = _distorted(c, m)
    before = d[..., 0] * sensor[0] + d[..., 1] * sensor[1] + sensor[2]
    return np.asarray(np.minimum(least, before).min(axis=1))
