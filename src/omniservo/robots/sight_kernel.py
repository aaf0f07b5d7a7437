"""How near an arm's links come to the lines of sight of its camera, compiled."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from omniservo.geometry.arrays import FloatArray, IntArray
from omniservo.geometry.held import held
from omniservo.geometry.kernel import kernel, leaf
from omniservo.robots.chain import Chain
from omniservo.robots.clearance_kernels import place_all
from omniservo.robots.gap_search import widen
from omniservo.robots.shapes import Scene, Shapes

SHAPE, POINT, GAP, LEFT = range(4)
"""Places in ``found``: the shape and the point of the pair with the least left, a lower bound of their
distance (−∞: they may touch), and what is left of it."""

_ROUNDING = 1e-8
"""[m] that floating point may have taken from a gap"""


class Sights(NamedTuple):
    """A camera's lines of sight."""

    points: FloatArray
    """(m, 3) that stand still [m]"""
    centre: FloatArray
    """(3,) of the camera at q = 0 [m]"""
    links: IntArray
    """(k,) the shapes that may hide a point"""
    line: IntArray
    """(1,) the shape that becomes every line in turn: a thin capsule"""
    kept: FloatArray
    """(g,) what each shape keeps from every line [m]"""


@kernel
def nearest_to_sights(
    chain: Chain,
    shapes: Shapes,
    scene: Scene,
    sights: Sights,
    q: FloatArray,
    turns: FloatArray,
    found: FloatArray,
) -> None:
    """Write which link leaves least of a line, in the posture q (n,), with what ``turns`` (n,) take of it.

    That is beyond what the link keeps.

    As seen from a link that k joints carry, the line's one end, the camera's centre c, is moved by the joints
    behind it, Σ_{j>k} r_j(c) · turn_j at most (`gap_kernels.farthest_moves`); its other one, the point p, by
    those before it, Σ_{j≤k} r_j(p) · turn_j. No point of the line goes farther than the larger of these.
    """
    chain, shapes, scene, sights = held(chain), held(shapes), held(scene), held(sights)
    n, line, normal = q.shape[0], sights.line[0], np.empty(3)
    place_all(chain, shapes, q, scene)
    centre, last = np.empty(3), scene.frames[n]
    for k in range(3):
        centre[k] = last[k, 3]
        for m in range(3):
            centre[k] += last[k, m] * sights.centre[m]
    of_centre, of_point = np.zeros(n + 1), np.zeros(n + 1)
    for j in range(n - 1, -1, -1):
        of_centre[j] = of_centre[j + 1] + turns[j] * _across(scene.anchors[j], scene.directions[j], centre)
    found[LEFT] = math.inf
    ends, simplex = np.empty(6), np.empty((4, 7))
    for i in range(sights.points.shape[0]):
        point = sights.points[i]
        for j in range(n):
            of_point[j + 1] = of_point[j] + turns[j] * _across(scene.anchors[j], scene.directions[j], point)
        lay(centre, point, shapes.sizes[line], scene.places[line], scene.axes[line])
        for g in sights.links:
            moved = max(of_centre[shapes.carried[g]], of_point[shapes.carried[g]])
            needed = moved + sights.kept[g] + _ROUNDING
            if _off_line(centre, point, scene.places[g]) - shapes.radii[g] > needed:
                continue
            normal[0], normal[1], normal[2] = 0.0, 0.0, 0.0
            gap, nearest = widen(
                g, line, shapes.kinds, shapes.sizes, shapes.corners, shapes.firsts, scene.places, scene.axes,
                normal, ends, simplex,
            )  # fmt: skip
            if gap - needed < found[LEFT]:
                found[SHAPE], found[POINT], found[LEFT] = g, i, gap - needed
                found[GAP] = gap if nearest < math.inf else -math.inf


@leaf
def _across(anchor: FloatArray, axis: FloatArray, p: FloatArray) -> float:
    """Return the distance of a point (3,) from a joint's axis [m]."""
    x, y, z = p[0] - anchor[0], p[1] - anchor[1], p[2] - anchor[2]
    a, b, c = axis[0], axis[1], axis[2]
    return math.sqrt((y * c - z * b) ** 2 + (z * a - x * c) ** 2 + (x * b - y * a) ** 2)


@leaf
def lay(centre: FloatArray, point: FloatArray, size: FloatArray, place: FloatArray, axes: FloatArray) -> None:
    """Put a capsule, whose axis is z, from the camera's centre to a point."""
    length = 0.0
    for k in range(3):
        place[k] = 0.5 * (centre[k] + point[k])
        length += (point[k] - centre[k]) ** 2
    length = math.sqrt(length)
    size[1] = 0.5 * length
    x, y, z = 0.0, 0.0, 1.0
    if length > 0.0:
        x, y, z = (
            (point[0] - centre[0]) / length,
            (point[1] - centre[1]) / length,
            (point[2] - centre[2]) / length,
        )
    side = math.copysign(1.0, z)  # any two axes across (Duff et al. 2017)
    a = -1.0 / (side + z)
    b = x * y * a
    axes[0], axes[3], axes[6] = 1.0 + side * x * x * a, side * b, -side * x
    axes[1], axes[4], axes[7] = b, side + y * y * a, -y
    axes[2], axes[5], axes[8] = x, y, z


@leaf
def _off_line(begin: FloatArray, end: FloatArray, p: FloatArray) -> float:
    """Return the distance of a point (3,) from the segment between two (3,) [m]."""
    square, along = 0.0, 0.0
    for k in range(3):
        square += (end[k] - begin[k]) ** 2
        along += (end[k] - begin[k]) * (p[k] - begin[k])
    share, off = min(1.0, max(0.0, along / max(square, 1e-300))), 0.0
    for k in range(3):
        off += (p[k] - begin[k] - share * (end[k] - begin[k])) ** 2
    return math.sqrt(off)
