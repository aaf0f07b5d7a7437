"""A search for the direction across which the slab between two convex bodies is widest, compiled.

The support point of B − A against a direction shows how wide its slab is (`gap_kernels`), and where the next
direction lies: from the origin to the nearest point of the segment between what was nearest so far and that
support point (Gilbert 1966). Whatever it comes to, the slab's width is a lower bound of the distance.
"""

from __future__ import annotations

import math

from omniservo.geometry.arrays import FloatArray, IntArray
from omniservo.geometry.kernel import leaf
from omniservo.robots.gap_kernels import BOX, CAPSULE, CYLINDER, ELLIPSOID, SPHERE

_STEPS = 16
"""at most: where bodies are far apart for their size, one or two will do"""

_ENOUGH = 1e-4
"""A slab is wide enough if a wider one could gain no more than this part of its width."""

_ON_TOP = 1e-9
"""[m] nearer bodies leave no direction between them"""


@leaf
def support(
    kind: int, size: FloatArray, axes: FloatArray, corners: FloatArray, x: float, y: float, z: float
) -> tuple[float, float, float]:
    """Return the point of a shape, about its own origin, that is farthest along n = (x, y, z), a unit vector.

    Arguments as of `gap_kernels.extent`.
    """
    a = axes[0] * x + axes[3] * y + axes[6] * z
    b = axes[1] * x + axes[4] * y + axes[7] * z
    c = axes[2] * x + axes[5] * y + axes[8] * z
    if kind == SPHERE:
        return size[0] * x, size[0] * y, size[0] * z
    u, v, w = 0.0, 0.0, 0.0
    if kind == CAPSULE:
        u, v, w = size[0] * a, size[0] * b, size[0] * c + math.copysign(size[1], c)
    elif kind == CYLINDER:
        across = max(math.sqrt(a * a + b * b), _ON_TOP)
        u, v, w = size[0] * a / across, size[0] * b / across, math.copysign(size[1], c)
    elif kind == BOX:
        u, v, w = math.copysign(size[0], a), math.copysign(size[1], b), math.copysign(size[2], c)
    elif kind == ELLIPSOID:
        length = math.sqrt((size[0] * a) ** 2 + (size[1] * b) ** 2 + (size[2] * c) ** 2)
        u, v, w = size[0] ** 2 * a / length, size[1] ** 2 * b / length, size[2] ** 2 * c / length
    else:
        most, best = -math.inf, 0
        for i in range(corners.shape[0]):
            along = a * corners[i, 0] + b * corners[i, 1] + c * corners[i, 2]
            if along > most:
                most, best = along, i
        u, v, w = corners[best, 0], corners[best, 1], corners[best, 2]
    return (
        axes[0] * u + axes[1] * v + axes[2] * w,
        axes[3] * u + axes[4] * v + axes[5] * w,
        axes[6] * u + axes[7] * v + axes[8] * w,
    )


@leaf
def widen(
    i: int,
    j: int,
    kinds: IntArray,
    sizes: FloatArray,
    corners: FloatArray,
    firsts: IntArray,
    places: FloatArray,
    axes: FloatArray,
    normal: FloatArray,
    ends: FloatArray,
) -> tuple[float, bool]:
    """Return a lower bound of two shapes' distance [m], and whether the distance is hardly more.

    Args:
        i: the first shape.
        j: the second.
        kinds: (g,) and the next five: see `gap_kernels.lower_gaps`.
        sizes: (g, 3) [m].
        corners: (v, 3) [m].
        firsts: (g + 1,)
        places: (g, 3) [m].
        axes: (g, 9)
        normal: (3,) where the search begins, 0: anywhere; out: across the widest slab that was found.
        ends: (6,) out: a point of each shape on that slab's sides [m].
    """
    first, second = corners[firsts[i] : firsts[i + 1]], corners[firsts[j] : firsts[j + 1]]
    dx, dy, dz = places[j, 0] - places[i, 0], places[j, 1] - places[i, 1], places[j, 2] - places[i, 2]
    px, py, pz = dx, dy, dz
    x, y, z = normal[0], normal[1], normal[2]
    begun = x != 0.0 or y != 0.0 or z != 0.0
    widest = -math.inf
    for step in range(_STEPS):
        if step > 0 or not begun:
            length = math.sqrt(px * px + py * py + pz * pz)
            if not length > _ON_TOP:
                return widest, False
            x, y, z = px / length, py / length, pz / length
        ax, ay, az = support(kinds[i], sizes[i], axes[i], first, x, y, z)
        bx, by, bz = support(kinds[j], sizes[j], axes[j], second, -x, -y, -z)
        sx, sy, sz = dx + bx - ax, dy + by - ay, dz + bz - az
        width = sx * x + sy * y + sz * z
        if width > widest:
            widest = width
            normal[0], normal[1], normal[2] = x, y, z
            ends[0], ends[1], ends[2] = places[i, 0] + ax, places[i, 1] + ay, places[i, 2] + az
            ends[3], ends[4], ends[5] = places[j, 0] + bx, places[j, 1] + by, places[j, 2] + bz
        if step == 0 and begun:
            px, py, pz = sx, sy, sz
            continue
        length = math.sqrt(px * px + py * py + pz * pz)
        if length - widest <= _ENOUGH * length:
            return widest, True
        ux, uy, uz = px - sx, py - sy, pz - sz
        square = ux * ux + uy * uy + uz * uz
        share = min(max((px * ux + py * uy + pz * uz) / max(square, 1e-300), 0.0), 1.0)
        px, py, pz = px - share * ux, py - share * uy, pz - share * uz
    return widest, False
