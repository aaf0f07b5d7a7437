"""Many points covered by a bounded number of boxes: what judges convex bodies then judges a cloud."""

import math
from typing import NamedTuple

import numpy as np

from omniservo.geometry.arrays import BoolArray, FloatArray
from omniservo.geometry.kernel import kernel, leaf
from omniservo.planning.obstacles.ball_tree import select

MOST_BOXES = 256
"""for one cloud: twice as many cost twice the time, and gain little"""

_ENOUGH = 1e-3
"""[m] A box that goes no farther beyond its balls, where it is looked at, is not halved."""

_ROUNDING = 1e-14
"""Boxes are larger by this part of the largest coordinate: some fifty roundings."""

KEY = 3
"""Column of a point's place along its box, by which it is halved."""


class CloudBoxes(NamedTuple):
    """Boxes turned as their points lie: every ball of the cloud lies in at least one of them."""

    middles: FloatArray
    """(m, 3) [m], m ≤ `MOST_BOXES`"""
    axes: FloatArray
    """(m, 3, 3) rotations: columns are the box's axes"""
    half_extents: FloatArray
    """(m, 3) [m], ≥ the radius"""
    single: BoolArray
    """(m,) whose points are all in one place: one ball would do"""


@kernel
def cloud_boxes(points: FloatArray, radius: float, most: int) -> CloudBoxes:
    """Return boxes that hold the balls of ``radius`` about points (p, 3), p ≥ 1 [m].

    A box's axes are the principal axes of its points, so one on a surface is thin, however that is turned.
    The box that goes farthest beyond its balls is halved across its longest side, half of its points to
    either side, until there are ``most`` or all are tight. How far it goes is looked at in 27 places: its
    corners, the middles of edges and faces, its own. Where all of its points are one it is left as it is.
    """
    rows = np.empty((points.shape[0], 4))
    rows[:, :KEY] = points
    larger = radius + _ROUNDING * (np.abs(points).max() + radius)
    most = min(most, points.shape[0])
    middles, axes, halves = np.empty((most, 3)), np.empty((most, 3, 3)), np.empty((most, 3))
    spans, beyond, count = np.empty((most, 2), np.int64), np.empty(most), 1
    spans[0, 0], spans[0, 1] = 0, points.shape[0]
    beyond[0] = _fit(rows, radius, larger, middles[0], axes[0], halves[0])
    while count < most:
        i = int(np.argmax(beyond[:count]))
        if beyond[i] <= _ENOUGH:
            break
        first, end = spans[i]
        middle = first + (end - first) // 2
        _write_keys(rows[first:end], middles[i], axes[i, :, int(np.argmax(halves[i]))])
        select(rows, first, end - 1, middle, KEY)
        spans[i, 1], spans[count, 0], spans[count, 1] = middle, middle, end
        for k in (i, count):
            own = rows[spans[k, 0] : spans[k, 1]]
            beyond[k] = _fit(own, radius, larger, middles[k], axes[k], halves[k])
        count += 1
    single = np.empty(count, np.bool_)
    for i in range(count):
        single[i] = halves[i].max() <= larger
    return CloudBoxes(middles[:count], axes[:count], halves[:count], single)


@leaf
def _write_keys(rows: FloatArray, middle: FloatArray, axis: FloatArray) -> None:
    """Write each row's place along an axis into its column `KEY`."""
    for i in range(rows.shape[0]):
        rows[i, KEY] = 0.0
        for a in range(3):
            rows[i, KEY] += (rows[i, a] - middle[a]) * axis[a]


@kernel
def _fit(
    rows: FloatArray, radius: float, larger: float, middle: FloatArray, axes: FloatArray, half: FloatArray
) -> float:
    """Write the box of rows (p, 4); return how far it goes beyond the balls [m], 0 where all are one."""
    mean, spread = np.zeros(3), np.zeros((3, 3))
    for i in range(rows.shape[0]):
        for a in range(3):
            mean[a] += rows[i, a] / rows.shape[0]
    for i in range(rows.shape[0]):
        for a in range(3):
            for b in range(3):
                spread[a, b] += (rows[i, a] - mean[a]) * (rows[i, b] - mean[b])
    axes[:] = np.linalg.eigh(spread)[1]
    if np.linalg.det(axes) < 0.0:
        axes[:, 0] *= -1.0
    low, high = np.full(3, math.inf), np.full(3, -math.inf)
    for i in range(rows.shape[0]):
        for b in range(3):
            along = 0.0
            for a in range(3):
                along += (rows[i, a] - mean[a]) * axes[a, b]
            low[b], high[b] = min(low[b], along), max(high[b], along)
    for b in range(3):
        half[b] = 0.5 * (high[b] - low[b]) + larger
    for a in range(3):
        middle[a] = mean[a]
        for b in range(3):
            middle[a] += axes[a, b] * 0.5 * (low[b] + high[b])
    return 0.0 if half.max() <= larger else max(_farthest(rows, middle, axes, half) - radius, 0.0)


@leaf
def _farthest(rows: FloatArray, middle: FloatArray, axes: FloatArray, half: FloatArray) -> float:
    """Return the largest of the least distances of 27 places in a box from any of the points (p, 4)."""
    farthest = 0.0
    for place in range(27):
        x, y, z = middle[0], middle[1], middle[2]
        for b in range(3):
            along = half[b] * ((place // 3**b) % 3 - 1)
            x, y, z = x + axes[0, b] * along, y + axes[1, b] * along, z + axes[2, b] * along
        nearest = math.inf
        for i in range(rows.shape[0]):
            u, v, w = rows[i, 0] - x, rows[i, 1] - y, rows[i, 2] - z
            nearest = min(nearest, u * u + v * v + w * w)
        farthest = max(farthest, nearest)
    return math.sqrt(farthest)
