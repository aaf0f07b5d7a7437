"""Whether bodies keep off the lines of sight of an arm's camera, compiled."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from omniservo.geometry.arrays import FloatArray, IntArray
from omniservo.geometry.held import held
from omniservo.geometry.kernel import kernel, leaf
from omniservo.geometry.rotation_row import XX, XY, XZ, YX, YY, YZ, ZX, ZY, ZZ
from omniservo.robots.collision.clearance_kernels import place_all
from omniservo.robots.collision.gap_kernels import rounding
from omniservo.robots.collision.gap_search import widen
from omniservo.robots.collision.shapes import Bodies, PlacedShapes, Shapes
from omniservo.robots.kinematics.chain import Chain

SHAPE, POINT, LEFT = range(3)
"""Places in ``found``: the shape and the point of the pair with the least left, and the width of the slab
between the two [m]: negative where no slab keeps them apart."""

SURFACE = 1e-3
"""[m] of every line of sight before its point that are not checked: what is met there is the surface that
the point lies on"""


class Sights(NamedTuple):
    """A camera's lines of sight, and what may hide its points."""

    points: FloatArray
    """(m, 3) that stand still [m]"""
    centre: FloatArray
    """(3,) of the camera at q = 0 [m]"""
    hiders: IntArray
    """(k,) the shapes that may hide a point"""
    line: int
    """the shape that becomes every line in turn: the hull of two balls"""
    at_camera: FloatArray
    """(g,) what each shape keeps from the lines at the camera's centre [m]"""
    at_points: FloatArray
    """(g,) what it keeps at the points, linearly less or more in between [m]"""


@kernel
def nearest_to_sights(
    chain: Chain,
    shapes: Shapes,
    scene: PlacedShapes,
    sights: Sights,
    q: FloatArray,
    turns: FloatArray,
    found: FloatArray,
) -> None:
    """Write which shape leaves least of a line at the joints q (n,), whatever ``turns`` (n,) take of it.

    As seen from a shape that k joints carry, the line's one end, the camera's centre c, is moved by the
    joints behind it, Σ_{j>k} r_j(c) · turn_j at most (`gap_kernels.farthest_moves`); its other one, the point
    p, by those before it, Σ_{j≤k} r_j(p) · turn_j. What the shape is to keep there comes on top. A place on
    the line at the share s between them goes no farther than (1 − s) of the one plus s of the other: the line
    stays in the hull of two balls, and is free where a slab lies between that hull and the shape.

    Of the line the last `SURFACE` does not count. It becomes no longer than L + Σ_j r_j(c) · turn_j, so that
    what counts ends at no larger share of it than 1 − SURFACE / that.
    """
    chain, shapes, scene, sights = held(chain), held(shapes), held(scene), held(sights)
    n, line, normal = q.shape[0], sights.line, np.empty(3)
    place_all(chain, shapes, q, scene)
    centre, last, end = np.empty(3), scene.frames[n], np.empty(3)
    for k in range(3):
        centre[k] = last[k, 3]
        for m in range(3):
            centre[k] += last[k, m] * sights.centre[m]
    of_centre, of_point = np.zeros(n + 1), np.zeros(n + 1)
    for j in range(n - 1, -1, -1):
        of_centre[j] = of_centre[j + 1] + turns[j] * _across(scene.anchors[j], scene.directions[j], centre)
    bodies = Bodies(
        shapes.kinds, shapes.sizes, shapes.radii, shapes.corners, shapes.firsts, scene.places, scene.axes
    )
    found[LEFT] = math.inf
    ends, simplex, size = np.empty(6), np.empty((4, 7)), shapes.sizes[line]
    for i in range(sights.points.shape[0]):
        point = sights.points[i]
        for j in range(n):
            of_point[j + 1] = of_point[j] + turns[j] * _across(scene.anchors[j], scene.directions[j], point)
        share = shown_of(centre, point, of_centre[0], end)
        lay(centre, end, size, scene.places[line], scene.axes[line])
        for g in sights.hiders:
            carried = shapes.carried[g]
            size[0] = of_centre[carried] + sights.at_camera[g]
            size[2] = (1.0 - share) * size[0] + share * (of_point[carried] + sights.at_points[g])
            rounded = rounding(g, line, scene.places, shapes.radii)
            size[0] += rounded
            size[2] += rounded
            if _off_line(centre, end, scene.places[g]) - shapes.radii[g] > max(size[0], size[2]):
                continue
            normal[0], normal[1], normal[2] = 0.0, 0.0, 0.0
            left, _ = widen(bodies, g, line, normal, ends, simplex)
            if left < found[LEFT]:
                found[SHAPE], found[POINT], found[LEFT] = g, i, left


@leaf
def _across(anchor: FloatArray, axis: FloatArray, p: FloatArray) -> float:
    """Return the distance of a point (3,) from a joint's axis [m]."""
    x, y, z = p[0] - anchor[0], p[1] - anchor[1], p[2] - anchor[2]
    a, b, c = axis[0], axis[1], axis[2]
    return math.sqrt((y * c - z * b) ** 2 + (z * a - x * c) ** 2 + (x * b - y * a) ** 2)


@leaf
def shown_of(centre: FloatArray, point: FloatArray, longer: float, end: FloatArray) -> float:
    """Write where a line of sight (3,) to a point (3,) ends, and return the share of it that is before.

    That is `SURFACE` before the point, if the line were longer by ``longer`` [m].
    """
    square = 0.0
    for k in range(3):
        square += (point[k] - centre[k]) ** 2
    share = 1.0 - SURFACE / max(math.sqrt(square) + longer, SURFACE)
    for k in range(3):
        end[k] = centre[k] + share * (point[k] - centre[k])
    return share


@leaf
def lay(centre: FloatArray, point: FloatArray, size: FloatArray, place: FloatArray, axes: FloatArray) -> None:
    """Put a body with the axis z from the camera's centre to a point; ``size[1]`` becomes half its length."""
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
    axes[XX], axes[YX], axes[ZX] = 1.0 + side * x * x * a, side * b, -side * x
    axes[XY], axes[YY], axes[ZY] = b, side + y * y * a, -y
    axes[XZ], axes[YZ], axes[ZZ] = x, y, z


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
