"""Moving obstacles: at w an obstacle is displaced by m(w), so what holds for it holds for t − m and h − m.

A motion is a polynomial; a table of motions is (M, 3, K+1), highest power first [m], and an obstacle's row
says which is its own (−1: it stands still).
"""

import numpy as np

from omniservo.geometry.arrays import FloatArray
from omniservo.geometry.kernel import kernel, leaf
from omniservo.geometry.polynomial import bernstein_from_power, magnitude


@leaf
def displacement(motions: FloatArray, index: float, w: float) -> tuple[float, float, float]:
    """Return m(w) [m]; 0 where the index is −1."""
    x, y, z = 0.0, 0.0, 0.0
    if index >= 0.0:
        motion = motions[int(index)]
        for k in range(motion.shape[1]):
            x, y, z = x * w + motion[0, k], y * w + motion[1, k], z * w + motion[2, k]
    return x, y, z


@leaf
def motion_degree(motion: FloatArray) -> int:
    """Return the degree of a motion (3, K+1), without leading zeros."""
    top = 0
    last = motion.shape[1] - 1
    while top < last and motion[0, top] == 0.0 and motion[1, top] == 0.0 and motion[2, top] == 0.0:
        top += 1
    return int(last - top)


@kernel
def seen_from_body(
    centre: FloatArray, translation: FloatArray, size: float, motions: FloatArray, index: float
) -> tuple[FloatArray, float]:
    """Return the control points of t − m (3, max(τ, k)+1) and a magnitude of those of t − m and h − m.

    The coefficients of t − m round once each: count max(τ, k) + 3. Of an obstacle that stands still they are
    ``centre``, those of t, with the magnitude ``size``.
    """
    if index < 0.0:
        return centre, size
    motion = motions[int(index)]
    powers = less_motion(translation, motion)
    return bernstein_from_power(powers), magnitude(powers) + magnitude(motion)


@kernel
def less_motion(translation: FloatArray, motion: FloatArray) -> FloatArray:
    """Return the powers of t − m (3, max(τ, k)+1), highest first; each rounds once."""
    k, tau, last = motion_degree(motion), translation.shape[1] - 1, motion.shape[1] - 1
    n = max(tau, k)
    powers = np.zeros((3, n + 1))
    for c in range(3):
        for i in range(tau + 1):
            powers[c, n - i] += translation[c, tau - i]
        for i in range(k + 1):
            powers[c, n - i] -= motion[c, last - i]
    return powers


@kernel
def point_from_body(h: FloatArray, motions: FloatArray, index: float) -> FloatArray:
    """Return the control points of h − m (3, k+1); of an obstacle that stands still h itself (3, 1).

    Count k + 3, magnitude |h| + that of m.
    """
    if index < 0.0:
        still = np.empty((3, 1))
        for c in range(3):
            still[c, 0] = h[c]
        return still
    motion = motions[int(index)]
    k, last = motion_degree(motion), motion.shape[1] - 1
    powers = np.empty((3, k + 1))
    for c in range(3):
        for i in range(k + 1):
            powers[c, k - i] = -motion[c, last - i]
        powers[c, k] += h[c]
    return bernstein_from_power(powers)
