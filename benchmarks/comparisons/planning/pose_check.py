"""The constraints of a `Neutral` at poses, compiled: for dense checks, and for those who ask pose by pose.

Values are those of `samples`. Written from the claims, apart from the planner's kernels.
"""

from __future__ import annotations

import math

import numpy as np
from benchmarks.comparisons.planning.neutral import SMALLEST_UNIT, Neutral

from omniservo.geometry.arrays import FloatArray
from omniservo.geometry.kernel import kernel

FAMILIES = ("visibility", "dead_zone", "least_distance", "clearance", "occlusion")


@kernel
def pose_values(neutral: Neutral, quaternion: FloatArray, t: FloatArray, least: FloatArray) -> float:
    """Return the smallest g at a pose; lower ``least`` (5,), by `FAMILIES`, to what it has there.

    ``quaternion`` (4,) is (x, y, z, w) of any length but 0.
    """
    qx, qy, qz, qw = quaternion[0], quaternion[1], quaternion[2], quaternion[3]
    f = 2.0 / (qx * qx + qy * qy + qz * qz + qw * qw)
    xx, xy, xz = 1.0 - f * (qy * qy + qz * qz), f * (qx * qy + qz * qw), f * (qx * qz - qy * qw)
    yx, yy, yz = f * (qx * qy - qz * qw), 1.0 - f * (qx * qx + qz * qz), f * (qy * qz + qx * qw)
    zx, zy, zz = f * (qx * qz + qy * qw), f * (qy * qz - qx * qw), 1.0 - f * (qx * qx + qy * qy)
    worst, ell = math.inf, neutral.ell
    for j in range(neutral.points.shape[0]):
        a, b, c = neutral.points[j, 0] - t[0], neutral.points[j, 1] - t[1], neutral.points[j, 2] - t[2]
        distance = max(math.sqrt(a * a + b * b + c * c), 1e-12)
        x, y, z = (xx * a + xy * b + xz * c) / distance, (yx * a + yy * b + yz * c) / distance, 0.0
        z = (zx * a + zy * b + zz * c) / distance
        for i in range(neutral.limits.shape[0]):
            n = neutral.limits[i]
            worst = _lower(least, 0, n[3] - (n[0] * x + n[1] * y + n[2] * z), worst)
        if neutral.disc.shape[0] > 0:
            disc = neutral.disc
            d = z + disc[6]
            u, v = disc[0] * x + disc[1] * y + disc[3] * d, disc[2] * y + disc[4] * d
            worst = _lower(least, 1, (math.sqrt(u * u + v * v) - disc[5] * d) / abs(disc[0]), worst)
        worst = _lower(least, 2, (distance - neutral.least_distance) / ell, worst)
    for i in range(neutral.spheres.shape[0]):
        worst = min(worst, _sphere(neutral, neutral.spheres[i], t, least))
    for i in range(neutral.boxes.shape[0]):
        worst = _lower(least, 3, box_value(neutral.boxes[i], t, ell), worst)
    return worst


@kernel
def _lower(least: FloatArray, family: int, value: float, worst: float) -> float:
    least[family] = min(least[family], value)
    return min(worst, value)


@kernel
def _sphere(neutral: Neutral, row: FloatArray, t: FloatArray, least: FloatArray) -> float:
    """Return the smallest g of one sphere: its clearance, and the lines of sight past it."""
    x, y, z = t[0] - row[0], t[1] - row[1], t[2] - row[2]
    square, worst = x * x + y * y + z * z, math.inf
    if row[4] > 0.0:
        unit = max(row[4], SMALLEST_UNIT * neutral.ell)
        worst = _lower(least, 3, (math.sqrt(square) - row[4]) / unit, worst)
    if neutral.occlusion and row[3] > 0.0:
        unit = max(row[3], SMALLEST_UNIT * neutral.ell)
        for j in range(neutral.points.shape[0]):
            h = neutral.points[j]
            a, b, c = h[0] - t[0], h[1] - t[1], h[2] - t[2]
            part = -(x * a + y * b + z * c) / max(a * a + b * b + c * c, 1e-300)
            part = min(max(part, 0.0), 1.0)
            px, py, pz = x + part * a, y + part * b, z + part * c
            gap = math.sqrt(px * px + py * py + pz * pz)
            worst = _lower(least, 4, (gap - row[3]) / unit, worst)
    return worst


@kernel
def box_value(row: FloatArray, t: FloatArray, ell: float) -> float:
    """Return g of a box (16,) at the centre t."""
    x, y, z = t[0] - row[0], t[1] - row[1], t[2] - row[2]
    square, depth = 0.0, -math.inf
    for k in range(3):
        beyond = abs(row[3 + 3 * k] * x + row[4 + 3 * k] * y + row[5 + 3 * k] * z) - row[12 + k]
        square += max(beyond, 0.0) ** 2
        depth = max(depth, beyond)
    signed = math.sqrt(square) if square > 0.0 else depth
    return float((signed - row[15]) / max(row[15], SMALLEST_UNIT * ell))


@kernel
def pose_is_free(neutral: Neutral, quaternion: FloatArray, t: FloatArray) -> bool:
    """Tell whether a pose keeps every constraint."""
    return pose_values(neutral, quaternion, t, np.zeros(5)) >= 0.0


@kernel
def least_values(neutral: Neutral, quaternions: FloatArray, positions: FloatArray) -> tuple[FloatArray, int]:
    """Return the smallest g of every family (5,) over poses (s, 4), (s, 3), and the index of the worst pose.

    A family without constraints stays at ∞.
    """
    least = np.full(5, np.inf)
    worst, index = math.inf, 0
    for s in range(positions.shape[0]):
        value = pose_values(neutral, quaternions[s], positions[s], least)
        if value < worst:
            worst, index = value, s
    return least, index
