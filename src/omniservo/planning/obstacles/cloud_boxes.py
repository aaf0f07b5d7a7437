"""Many points covered by a bounded number of boxes: what judges convex bodies then judges a cloud."""

import math
from typing import NamedTuple

import numpy as np

from omniservo.geometry.arrays import BoolArray, FloatArray
from omniservo.geometry.kernel import kernel, leaf
from omniservo.planning.obstacles.ball_tree import BallTree, nearest_point, select

MOST_BOXES = 256
"""for one cloud: with twice as many a plan takes almost twice the time, and few more are found"""

_ENOUGH = 1e-3
"""[m] A box that goes no farther beyond its balls, where it is checked, is not halved."""

_SAMPLED = 64
"""Points of a cloud whose nearest neighbours say how dense it is, most of it."""

_MOST_OF_IT = 0.9
_WIDER = 2.0
"""A gap is one where no point is for so many times what lies between neighbours."""

_LESS = 0.7
"""A box is halved across a shorter side where that leaves so much of the volume of another way."""

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
def cloud_boxes(tree: BallTree, radius: float, most: int) -> CloudBoxes:
    """Return boxes that hold the balls of ``radius`` [m] about the points of a tree.

    A box's axes are the principal axes of its points, so one on a surface is thin, however that is turned.
    The box that goes farthest beyond the balls is halved, half of its points to either side, until there are
    ``most`` or all are tight: across its longest side, or another that leaves boxes of less volume. How far
    it goes is checked in 27 places: its corners, the middles of edges and faces, its own. A thin box goes
    no farther than it is thick, unless it has a gap that is none between neighbours: else a wall seen by few
    rays would take all boxes there are.
    Where all points of a box are one it is left as it is.
    """
    points = tree.points
    rows = np.empty((points.shape[0], 4))
    rows[:, :KEY] = points
    gap = _WIDER * _between_neighbours(points) if points.shape[0] > most else 0.0
    larger = radius + _ROUNDING * (np.abs(points).max() + radius)
    most = min(most, points.shape[0])
    middles, axes, halves = np.empty((most, 3)), np.empty((most, 3, 3)), np.empty((most, 3))
    spans, beyond, count = np.empty((most, 2), np.int64), np.empty(most), 1
    spans[0, 0], spans[0, 1] = 0, points.shape[0]
    _fit(rows, larger, middles[0], axes[0], halves[0])
    beyond[0] = _beyond(tree, radius, larger, gap, middles[0], axes[0], halves[0])
    while count < most:
        i = int(np.argmax(beyond[:count]))
        if beyond[i] <= _ENOUGH:
            break
        first, end = spans[i]
        middle = first + (end - first) // 2
        _halve(rows[first:end], larger, middles[i], axes[i], halves[i])
        spans[i, 1], spans[count, 0], spans[count, 1] = middle, middle, end
        for k in (i, count):
            _fit(rows[spans[k, 0] : spans[k, 1]], larger, middles[k], axes[k], halves[k])
            beyond[k] = _beyond(tree, radius, larger, gap, middles[k], axes[k], halves[k])
        count += 1
    single = np.empty(count, np.bool_)
    for i in range(count):
        single[i] = halves[i].max() <= larger
    return CloudBoxes(middles[:count], axes[:count], halves[:count], single)


@kernel
def _between_neighbours(points: FloatArray) -> float:
    """Return how far most of some points are from the nearest other one at most [m]."""
    step = 1 + (points.shape[0] - 1) // _SAMPLED
    found = np.full(1 + (points.shape[0] - 1) // step, math.inf)
    for k in range(found.shape[0]):
        i = k * step
        for j in range(points.shape[0]):
            if j != i:
                u, v, w = (
                    points[j, 0] - points[i, 0],
                    points[j, 1] - points[i, 1],
                    points[j, 2] - points[i, 2],
                )
                found[k] = min(found[k], u * u + v * v + w * w)
    return math.sqrt(np.quantile(found, _MOST_OF_IT))


@kernel
def _halve(rows: FloatArray, larger: float, middle: FloatArray, axes: FloatArray, half: FloatArray) -> None:
    """Reorder the rows (p, 4) of a box so that boxes of the first half and of the others are small."""
    order = np.argsort(half)
    best, least = order[2], math.inf
    room, turned, size = np.empty(3), np.empty((3, 3)), np.empty(3)
    for axis in order[::-1]:
        _part(rows, middle, axes[:, axis])
        volume = 0.0
        for part in (rows[: rows.shape[0] // 2], rows[rows.shape[0] // 2 :]):
            _fit(part, larger, room, turned, size)
            volume += size[0] * size[1] * size[2]
        if volume < _LESS * least:
            best, least = axis, volume
    if best != order[0]:
        _part(rows, middle, axes[:, best])


@leaf
def _part(rows: FloatArray, middle: FloatArray, axis: FloatArray) -> None:
    """Reorder rows (p, 4): those of the first half are no farther along an axis than the others."""
    for i in range(rows.shape[0]):
        rows[i, KEY] = 0.0
        for a in range(3):
            rows[i, KEY] += (rows[i, a] - middle[a]) * axis[a]
    select(rows, 0, rows.shape[0] - 1, rows.shape[0] // 2, KEY)


@kernel
def _fit(rows: FloatArray, larger: float, middle: FloatArray, axes: FloatArray, half: FloatArray) -> None:
    """Write the box of rows (p, 4)."""
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


@kernel
def _beyond(
    tree: BallTree,
    radius: float,
    larger: float,
    gap: float,
    middle: FloatArray,
    axes: FloatArray,
    half: FloatArray,
) -> float:
    """Return how far a box goes beyond all balls [m], where it is checked; 0 for one of a single place."""
    if half.max() <= larger:
        return 0.0
    farthest, place = 0.0, np.empty(3)
    for corner in range(27):
        place[:] = middle
        for b in range(3):
            along = half[b] * ((corner // 3**b) % 3 - 1)
            for a in range(3):
                place[a] += axes[a, b] * along
        at = (place[0], place[1], place[2])
        farthest = max(farthest, nearest_point(tree.points, tree.nodes, at, at, math.inf)[1])
    farthest -= radius
    return float(max(min(farthest, 2.0 * (half.min() - radius)), farthest - gap, 0.0))
