"""Many points in a tree of balls: a part of them is proven, or passed over, as one ball.

A node is a row (7,): a centre c, a radius ρ with ‖p − c‖ ≤ ρ for all its points p, the first and the end of
its rows among the points, and the node that follows its subtree. Nodes stand in preorder, so a walk needs no
stack: on to i + 1 into the subtree, or to the follower past it. A leaf's follower is i + 1.
"""

import math
from typing import NamedTuple

import numpy as np

from omniservo.geometry.arrays import FloatArray
from omniservo.geometry.kernel import kernel, leaf

RADIUS, FIRST, END, NEXT = 3, 4, 5, 6
"""Columns of a node after its centre."""

_LEAF = 8
"""Points of a leaf at most."""

_LARGER = 1.0 + 1e-14
"""A ball's radius is taken so much larger than computed: six roundings are below 1e-15."""

_SMALLEST = 1e-150
"""... and by this: below it squares underflow."""


class BallTree(NamedTuple):
    """A tree and its points."""

    points: FloatArray
    """(p, 3) [m], in the order of the leaves"""
    nodes: FloatArray
    """(k, 7), see above"""


@kernel
def ball_tree(points: FloatArray) -> BallTree:
    """Return the tree of points (p, 3), p ≥ 1: halved along the longest side, down to 8 points."""
    ordered = points.copy()
    nodes = np.empty((points.shape[0] // 2 + 1, 7))  # a leaf has 4 points or more, or is the only one
    pending = np.empty((64, 2), dtype=np.int64)
    pending[0, 0], pending[0, 1] = 0, points.shape[0]
    top, count = 0, 0
    while top >= 0:
        first, end = pending[top, 0], pending[top, 1]
        top -= 1
        axis = _enclose(ordered, first, end, nodes[count])
        count += 1
        if end - first > _LEAF:
            middle = first + (end - first) // 2
            select(ordered, first, end - 1, middle, axis)
            pending[top + 1, 0], pending[top + 1, 1] = middle, end
            pending[top + 2, 0], pending[top + 2, 1] = first, middle
            top += 2
    for i in range(count - 1, -1, -1):
        leaf = nodes[i, END] - nodes[i, FIRST] <= _LEAF
        nodes[i, NEXT] = i + 1 if leaf else nodes[int(nodes[i + 1, NEXT]), NEXT]
    return BallTree(ordered, nodes[:count])


@leaf
def _enclose(points: FloatArray, first: int, end: int, node: FloatArray) -> int:
    """Write the ball about rows ``first`` to ``end`` into ``node`` (7,); return their longest side's axis."""
    axis, longest = 0, -1.0
    for a in range(3):
        low, high = points[first, a], points[first, a]
        for i in range(first + 1, end):
            low, high = min(low, points[i, a]), max(high, points[i, a])
        node[a] = low + 0.5 * (high - low)
        if high - low > longest:
            axis, longest = a, high - low
    square = 0.0
    for i in range(first, end):
        x, y, z = points[i, 0] - node[0], points[i, 1] - node[1], points[i, 2] - node[2]
        square = max(square, x * x + y * y + z * z)
    node[RADIUS], node[FIRST], node[END] = math.sqrt(square) * _LARGER + _SMALLEST, first, end
    return axis


@leaf
def select(points: FloatArray, low: int, high: int, middle: int, axis: int) -> None:
    """Reorder rows ``low`` to ``high`` so that ``middle`` is where sorting by a column puts it (Hoare)."""
    while low < high:
        pivot = points[(low + high) // 2, axis]
        i, j = low, high
        while i <= j:
            while points[i, axis] < pivot:
                i += 1
            while points[j, axis] > pivot:
                j -= 1
            if i <= j:
                for a in range(points.shape[1]):
                    points[i, a], points[j, a] = points[j, a], points[i, a]
                i += 1
                j -= 1
        if middle <= j:
            high = j
        elif middle >= i:
            low = i
        else:
            return


@leaf
def nearest_point(
    points: FloatArray,
    nodes: FloatArray,
    t: tuple[float, float, float],
    h: tuple[float, float, float],
    limit: float,
) -> tuple[int, float]:
    """Return the point of a tree that is nearest to the segment from t to h, and its distance.

    −1 and ``limit`` where none is nearer than ``limit``.
    """
    best, i = -1, 0
    while nodes[i, NEXT] > i + 1:  # a leaf nearby, so that the walk passes over most of the tree
        other = int(nodes[i + 1, NEXT])
        i = other if segment_distance(nodes[other], t, h) < segment_distance(nodes[i + 1], t, h) else i + 1
    for k in range(int(nodes[i, FIRST]), int(nodes[i, END])):
        distance = segment_distance(points[k], t, h)
        if distance < limit:
            best, limit = k, distance
    i = 0
    while i < nodes.shape[0]:
        if segment_distance(nodes[i], t, h) - nodes[i, RADIUS] >= limit:
            i = int(nodes[i, NEXT])
            continue
        i += 1
        if nodes[i - 1, NEXT] == i:
            for k in range(int(nodes[i - 1, FIRST]), int(nodes[i - 1, END])):
                distance = segment_distance(points[k], t, h)
                if distance < limit:
                    best, limit = k, distance
    return best, limit


@leaf
def segment_distance(o: FloatArray, t: tuple[float, float, float], h: tuple[float, float, float]) -> float:
    """Return the distance of o (3,) or longer from the segment from t to h."""
    lx, ly, lz = h[0] - t[0], h[1] - t[1], h[2] - t[2]
    x, y, z = t[0] - o[0], t[1] - o[1], t[2] - o[2]
    square = lx * lx + ly * ly + lz * lz
    if square > 0.0:
        s = min(max(-(x * lx + y * ly + z * lz) / square, 0.0), 1.0)
        x, y, z = x + s * lx, y + s * ly, z + s * lz
    return math.sqrt(x * x + y * y + z * z)
