"""A search for the direction across which the slab between two convex bodies is widest, compiled.

Of B − A, the differences of the bodies' points, a few are known at a time; the point of their hull that is
nearest to the origin says how far apart the bodies are at most, and the support point of B − A against it how
far at least (`gap_kernels`); that one is known next, and those that do not matter are forgotten (Gilbert,
Johnson and Keerthi 1988). Whatever it comes to, the slab's width is a lower bound of the distance.
"""

from __future__ import annotations

import math

from omniservo.geometry.arrays import FloatArray
from omniservo.geometry.kernel import leaf
from omniservo.geometry.rotation_row import XZ, YZ, ZZ, turned, turned_back
from omniservo.robots.collision.gap_kernels import (
    BOX,
    CAPSULE,
    CYLINDER,
    ELLIPSOID,
    HALF_SPACE,
    SPHERE,
    TAPERED,
    height,
)
from omniservo.robots.collision.shapes import Bodies

_STEPS = 24
"""at most: polyhedra take a few, round bodies some more"""

_ENOUGH = 1e-7
"""A slab is wide enough if a wider one could gain no more than this part of the distance."""

_ON_TOP = 1e-9
"""[m] nearer bodies leave no direction between them"""

_NO_LENGTH = 1e-300
_LARGE = 1e6
"""Edges whose square is larger, beside that of the distance, say better than it which way it goes."""

_FLAT = 1e-12
"""A triangle whose squared area is this part of what its sides could have is taken for its sides."""


@leaf
def support(
    kind: int, size: FloatArray, axes: FloatArray, corners: FloatArray, x: float, y: float, z: float
) -> tuple[float, float, float]:
    """Return the point of a shape, about its own origin, that is farthest along n = (x, y, z), a unit vector.

    Arguments as of `gap_kernels.extent`.
    """
    a, b, c = turned_back(axes, x, y, z)
    if kind == SPHERE:
        return size[0] * x, size[0] * y, size[0] * z
    u, v, w = 0.0, 0.0, 0.0
    if kind == CAPSULE:
        u, v, w = size[0] * a, size[0] * b, size[0] * c + math.copysign(size[1], c)
    elif kind == CYLINDER:
        across = math.sqrt(a * a + b * b)
        if across > 0.0:
            u, v = size[0] * a / across, size[0] * b / across
        w = math.copysign(size[1], c)
    elif kind == BOX:
        u, v, w = math.copysign(size[0], a), math.copysign(size[1], b), math.copysign(size[2], c)
    elif kind == ELLIPSOID:
        length = math.sqrt((size[0] * a) ** 2 + (size[1] * b) ** 2 + (size[2] * c) ** 2)
        u, v, w = size[0] ** 2 * a / length, size[1] ** 2 * b / length, size[2] ** 2 * c / length
    elif kind == TAPERED:
        radius, along = (
            (size[0], -size[1]) if size[0] - size[1] * c > size[2] + size[1] * c else (size[2], size[1])
        )
        u, v, w = radius * a, radius * b, radius * c + along
    else:
        most, best = -math.inf, 0
        for i in range(corners.shape[0]):
            along = a * corners[i, 0] + b * corners[i, 1] + c * corners[i, 2]
            if along > most:
                most, best = along, i
        u, v, w = corners[best, 0], corners[best, 1], corners[best, 2]
    return turned(axes, u, v, w)


@leaf
def widen(
    bodies: Bodies, i: int, j: int, normal: FloatArray, ends: FloatArray, simplex: FloatArray
) -> tuple[float, float]:
    """Return a lower and an upper bound of two shapes' distance [m]; ∞: no upper one, they may touch.

    Args:
        bodies: the shapes where they are.
        i: the first shape; a half-space may be the first alone, and both bounds of it are the `height`.
        j: the second.
        normal: (3,) where the search begins, 0: anywhere; out: across the widest slab that was found.
        ends: (6,) out: a point of each shape [m], as far apart as the upper bound says.
        simplex: (4, 7) room.
    """
    kinds, sizes, places, axes, firsts = bodies.kinds, bodies.sizes, bodies.places, bodies.axes, bodies.firsts
    first, second = bodies.corners[firsts[i] : firsts[i + 1]], bodies.corners[firsts[j] : firsts[j + 1]]
    dx, dy, dz = places[j, 0] - places[i, 0], places[j, 1] - places[i, 1], places[j, 2] - places[i, 2]
    if kinds[i] == HALF_SPACE:
        normal[0], normal[1], normal[2] = axes[i, XZ], axes[i, YZ], axes[i, ZZ]
        gap = height(bodies, i, j)
        _onto_plane(kinds[j], sizes[j], axes[j], second, places[j], gap, normal, ends)
        return gap, gap
    x, y, z = _begun(normal, dx, dy, dz)
    widest, nearest, count = -math.inf, math.inf, 0
    for _ in range(_STEPS):
        ax, ay, az = support(kinds[i], sizes[i], axes[i], first, x, y, z)
        bx, by, bz = support(kinds[j], sizes[j], axes[j], second, -x, -y, -z)
        sx, sy, sz = dx + bx - ax, dy + by - ay, dz + bz - az
        width = sx * x + sy * y + sz * z
        if width > widest:
            widest = width
            normal[0], normal[1], normal[2] = x, y, z
        if (1.0 - _ENOUGH) * nearest <= widest:
            break
        own = simplex[count]
        own[0], own[1], own[2], own[3], own[4], own[5] = sx, sy, sz, ax, ay, az
        count = _reduce(simplex, count + 1)
        if count == 0:
            return widest, math.inf
        px, py, pz = _weighted(simplex, count, 0)
        length = math.sqrt(px * px + py * py + pz * pz)
        if not _ON_TOP < length < nearest:
            return widest, nearest if length > _ON_TOP else math.inf
        nearest = length
        _write_ends(places[i], _weighted(simplex, count, 3), (px, py, pz), ends)
        x, y, z = _square_to(simplex, count, px / length, py / length, pz / length, length)
    return widest, nearest


@leaf
def _write_ends(
    place: FloatArray, own: tuple[float, float, float], way: tuple[float, float, float], ends: FloatArray
) -> None:
    """Write a shape's point, ``own`` from its place, and the other's, which is ``way`` from there."""
    for k in range(3):
        ends[k] = place[k] + own[k]
        ends[3 + k] = ends[k] + way[k]


@leaf
def _begun(normal: FloatArray, dx: float, dy: float, dz: float) -> tuple[float, float, float]:
    """Return the unit vector that a search begins with; if none is known, from origin to origin."""
    if normal[0] != 0.0 or normal[1] != 0.0 or normal[2] != 0.0:
        return normal[0], normal[1], normal[2]
    length = math.sqrt(dx * dx + dy * dy + dz * dz)
    if not length > _ON_TOP:
        return 0.0, 0.0, 1.0
    return dx / length, dy / length, dz / length


@leaf
def _onto_plane(
    kind: int,
    size: FloatArray,
    axes: FloatArray,
    corners: FloatArray,
    place: FloatArray,
    gap: float,
    normal: FloatArray,
    ends: FloatArray,
) -> None:
    """Write a half-space's point that is nearest to a shape, and the shape's, ``gap`` along the normal."""
    bx, by, bz = support(kind, size, axes, corners, -normal[0], -normal[1], -normal[2])
    ends[3], ends[4], ends[5] = place[0] + bx, place[1] + by, place[2] + bz
    for k in range(3):
        ends[k] = ends[3 + k] - gap * normal[k]


@leaf
def _square_to(
    simplex: FloatArray, count: int, x: float, y: float, z: float, length: float
) -> tuple[float, float, float]:
    """Return the unit vector n = (x, y, z) made square to the edge or triangle that is nearest to the origin.

    Where that is much larger than its distance ``length``, rounding tilts n, and the slab across it is thin.
    """
    a, b, c = simplex[0, 0], simplex[0, 1], simplex[0, 2]
    for k in range(1, count):
        u, v, w = simplex[k, 0] - a, simplex[k, 1] - b, simplex[k, 2] - c
        if k == 2:  # what of the second edge is square to the first
            p, q, r = simplex[1, 0] - a, simplex[1, 1] - b, simplex[1, 2] - c
            share = (u * p + v * q + w * r) / max(p * p + q * q + r * r, _NO_LENGTH)
            u, v, w = u - share * p, v - share * q, w - share * r
        square = u * u + v * v + w * w
        if square > _LARGE * length * length:
            along = (x * u + y * v + z * w) / square
            x, y, z = x - along * u, y - along * v, z - along * w
    size = math.sqrt(x * x + y * y + z * z)
    return x / size, y / size, z / size


@leaf
def _weighted(simplex: FloatArray, count: int, first: int) -> tuple[float, float, float]:
    """Return the weighted sum of what stands in three columns."""
    x, y, z = 0.0, 0.0, 0.0
    for k in range(count):
        x += simplex[k, 6] * simplex[k, first]
        y += simplex[k, 6] * simplex[k, first + 1]
        z += simplex[k, 6] * simplex[k, first + 2]
    return x, y, z


@leaf
def _reduce(simplex: FloatArray, count: int) -> int:
    """Keep the points whose hull has the point nearest to the origin, the newest the last; write weights.

    Returns how many are kept; 0: the origin is inside.
    """
    last = count - 1
    if count == 1:
        simplex[0, 6] = 1.0
        return 1
    best, square = (last, last, last), math.inf
    a, b, c = 1.0, 0.0, 0.0
    if count == 2:
        square, u = _on_segment(simplex, 0, 1)
        best, a, b, c = (0, 1, 1), 1.0 - u, u, 0.0
    if count == 4 and _is_inside(simplex):
        return 0
    if count > 2:
        for k in range(1 if count == 3 else 3):
            i, j = (1 if k == 2 else 0), (1 if k == 0 else 2)
            found, u, v = _on_triangle(simplex, i, j, last)
            if found < square:
                square, best, a, b, c = found, (i, j, last), 1.0 - u - v, u, v
    kept = 0
    for k in range(3):
        weight = a if k == 0 else b if k == 1 else c
        if weight > 0.0:
            for m in range(6):
                simplex[kept, m] = simplex[best[k], m]
            simplex[kept, 6] = weight
            kept += 1
    return kept


@leaf
def _on_segment(simplex: FloatArray, i: int, j: int) -> tuple[float, float]:
    """Return the square of the least distance of the segment from the origin, and the share of point j."""
    a, b, c = simplex[i, 0], simplex[i, 1], simplex[i, 2]
    x, y, z = simplex[j, 0] - a, simplex[j, 1] - b, simplex[j, 2] - c
    u = -(a * x + b * y + c * z) / max(x * x + y * y + z * z, _NO_LENGTH)
    u = min(max(u, 0.0), 1.0)
    a, b, c = a + u * x, b + u * y, c + u * z
    return a * a + b * b + c * c, u


@leaf
def _on_triangle(simplex: FloatArray, i: int, j: int, k: int) -> tuple[float, float, float]:
    """Return the square of a triangle's least distance from the origin, and the shares of points j and k."""
    a, b, c = simplex[i, 0], simplex[i, 1], simplex[i, 2]
    x, y, z = simplex[j, 0] - a, simplex[j, 1] - b, simplex[j, 2] - c
    p, q, r = simplex[k, 0] - a, simplex[k, 1] - b, simplex[k, 2] - c
    xx, xp, pp = x * x + y * y + z * z, x * p + y * q + z * r, p * p + q * q + r * r
    ax, ap = a * x + b * y + c * z, a * p + b * q + c * r
    area = xx * pp - xp * xp
    if area > _FLAT * xx * pp:
        u, v = (xp * ap - pp * ax) / area, (xp * ax - xx * ap) / area
        if u >= 0.0 and v >= 0.0 and u + v <= 1.0:
            a, b, c = a + u * x + v * p, b + u * y + v * q, c + u * z + v * r
            return a * a + b * b + c * c, u, v
    square, u = _on_segment(simplex, i, j)
    v = 0.0
    found, share = _on_segment(simplex, i, k)
    if found < square:
        square, u, v = found, 0.0, share
    found, share = _on_segment(simplex, j, k)
    if found < square:
        square, u, v = found, 1.0 - share, share
    return square, u, v


@leaf
def _is_inside(simplex: FloatArray) -> bool:
    """Return whether the origin is inside a tetrahedron: of every face on the side of the fourth corner."""
    for face in range(4):
        i, j, k = (face + 1) % 4, (face + 2) % 4, (face + 3) % 4
        a, b, c = simplex[i, 0], simplex[i, 1], simplex[i, 2]
        x, y, z = simplex[j, 0] - a, simplex[j, 1] - b, simplex[j, 2] - c
        p, q, r = simplex[k, 0] - a, simplex[k, 1] - b, simplex[k, 2] - c
        u, v, w = y * r - z * q, z * p - x * r, x * q - y * p
        here = -(a * u + b * v + c * w)
        there = (simplex[face, 0] - a) * u + (simplex[face, 1] - b) * v + (simplex[face, 2] - c) * w
        if not here * there > 0.0:
            return False
    return True
