"""How far a segment is from a box with rounded edges: boxes and capsules are both of this kind.

A body is a row (25,): centre c, unit axes a₁ a₂ a₃ row by row, half extents e, radius r, reach r + clearance,
motion (see `motion`), six numbers of a mesh (see `solid_gap`), and the shape of its core. It is the ball of
radius r moved over its core; a box has r = 0, a capsule e = (half length, 0, 0), a sphere that moves e = 0.
"""

import math

from omniservo.geometry.arrays import FloatArray
from omniservo.geometry.kernel import leaf
from omniservo.geometry.rotation_row import turned, turned_back

BODY_SIZE = 25
"""Numbers of a row."""

AXES, EXTENT, RADIUS, REACH, MOTION, CORNERS, FACES, EDGES, SHAPE = 3, 12, 15, 16, 17, 18, 20, 22, 24
"""Where in a row: axes (9,), half extents e (3,), radius r, reach r + clearance [m], motion, of a mesh the
first and the end of its corners, faces and edges, and the core's shape."""

CUBOID, CYLINDER, ELLIPSOID, HULL = 0.0, 1.0, 2.0, 3.0
"""Shapes of a core: a box or less, a cylinder along a₁ with e = (half length, radius, radius), an ellipsoid
of radii e, the hull of vertices."""

_TOUCHING = 1e-14
"""Below this part of the distances involved, a gap's direction is only rounding."""


@leaf
def is_solid(body: FloatArray) -> bool:
    """Tell whether a body has volume: a point hides nothing."""
    return bool(body[RADIUS] > 0.0 or body[EXTENT] > 0.0)


@leaf
def in_body_frame(body: FloatArray, x: float, y: float, z: float) -> tuple[float, float, float]:
    """Return the coordinates a_k·v of a vector (x, y, z)."""
    return turned(body[AXES:EXTENT], x, y, z)


@leaf
def out_of_body_frame(body: FloatArray, x: float, y: float, z: float) -> tuple[float, float, float]:
    """Return x a₁ + y a₂ + z a₃."""
    return turned_back(body[AXES:EXTENT], x, y, z)


@leaf
def excess(x: float, h: float) -> float:
    """Return what of x lies outside [−h, h]."""
    return x - h if x > h else (x + h if x < -h else 0.0)


@leaf
def half_slope(
    p: tuple[float, float, float], d: tuple[float, float, float], e: tuple[float, float, float], s: float
) -> float:
    """Return half the derivative of the squared distance from p + s d to the box e at s."""
    total = 0.0
    for k in range(3):
        total += excess(p[k] + s * d[k], e[k]) * d[k]
    return total


@leaf
def nearest_part(
    p: tuple[float, float, float], d: tuple[float, float, float], e: tuple[float, float, float]
) -> float:
    """Return the s in [0, 1] at which p + s d is nearest to the box e.

    The squared distance is convex and quadratic between the six places where a coordinate passes ±e_k: its
    slope is bracketed between two of them, and linear there.
    """
    low, high = 0.0, 1.0
    before, after = half_slope(p, d, e, 0.0), half_slope(p, d, e, 1.0)
    if before >= 0.0:
        return 0.0
    if after <= 0.0:
        return 1.0
    for k in range(3):
        if d[k] != 0.0:
            for side in range(2):
                at = ((e[k] if side == 1 else -e[k]) - p[k]) / d[k]
                if low < at < high:
                    slope = half_slope(p, d, e, at)
                    if slope < 0.0:
                        low, before = at, slope
                    else:
                        high, after = at, slope
    return low + (high - low) * before / (before - after)


@leaf
def depth_inside(
    p: tuple[float, float, float], d: tuple[float, float, float], e: tuple[float, float, float], s: float
) -> tuple[float, float, float, float, float]:
    """Return (unit direction, −depth, s): the shortest move that takes the segment p, p + d out of the box e.

    Candidates are the box's faces and the directions across both the segment and an edge. s says which part
    of the segment obstructs: its ends for a face, the given s for an edge.
    """
    depth, x, y, z, part = math.inf, 1.0, 0.0, 0.0, 0.0
    for k in range(3):
        for side in range(2):
            sign = 1.0 if side == 1 else -1.0
            start, end = sign * p[k], sign * (p[k] + d[k])
            if e[k] - min(start, end) < depth:
                depth, part = e[k] - min(start, end), (0.0 if start <= end else 1.0)
                x, y, z = sign if k == 0 else 0.0, sign if k == 1 else 0.0, sign if k == 2 else 0.0
    for k in range(3):
        i, j = (k + 1) % 3, (k + 2) % 3
        norm = math.sqrt(d[i] * d[i] + d[j] * d[j])
        if norm > 0.0:
            ni, nj = d[j] / norm, -d[i] / norm
            along = ni * p[i] + nj * p[j]
            sign = 1.0 if along >= 0.0 else -1.0
            size = e[i] * abs(ni) + e[j] * abs(nj) - abs(along)
            if size < depth:
                depth, part = size, s
                ni, nj = sign * ni, sign * nj
                x = ni if i == 0 else (nj if j == 0 else 0.0)
                y = ni if i == 1 else (nj if j == 1 else 0.0)
                z = ni if i == 2 else (nj if j == 2 else 0.0)
    return x, y, z, -depth, part


@leaf
def segment_gap(
    body: FloatArray, tx: float, ty: float, tz: float, hx: float, hy: float, hz: float
) -> tuple[float, float, float, float, float]:
    """Return (unit direction n, gap, s) from the body's box to the segment from t to h.

    The gap is their distance, negative the depth, without the body's radius; t + s(h − t) is nearest.
    """
    p = in_body_frame(body, tx - body[0], ty - body[1], tz - body[2])
    d = in_body_frame(body, hx - tx, hy - ty, hz - tz)
    e = float(body[EXTENT]), float(body[EXTENT + 1]), float(body[EXTENT + 2])
    s = nearest_part(p, d, e)
    x, y, z = excess(p[0] + s * d[0], e[0]), excess(p[1] + s * d[1], e[1]), excess(p[2] + s * d[2], e[2])
    gap = math.sqrt(x * x + y * y + z * z)
    size = abs(p[0]) + abs(p[1]) + abs(p[2]) + abs(d[0]) + abs(d[1]) + abs(d[2]) + e[0] + e[1] + e[2]
    if gap > _TOUCHING * size:
        x, y, z = x / gap, y / gap, z / gap
    else:
        x, y, z, gap, s = depth_inside(p, d, e, s)
    nx, ny, nz = out_of_body_frame(body, x, y, z)
    return nx, ny, nz, gap, s
