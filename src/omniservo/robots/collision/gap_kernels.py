"""Gaps between convex bodies, and how far joints move them: bounds that hold whatever a search has found.

The width of the slab between two bodies across a unit vector n, min n·x over the one − max n·x over the
other, is a lower bound of their distance for every n, and the distance itself for the best one. So no one
needs to trust the search that proposes n.
"""

import math

import numpy as np

from omniservo.geometry.arrays import FloatArray, IntArray
from omniservo.geometry.kernel import kernel, leaf
from omniservo.geometry.rotation_row import XZ, YZ, ZZ, turned_back
from omniservo.robots.collision.shapes import Bodies

HALF_SPACE, SPHERE, CAPSULE, ELLIPSOID, CYLINDER, BOX, HULL = 0, 2, 3, 4, 5, 6, 7
"""MuJoCo's numbers of the shapes. A half-space is MuJoCo's plane: all of its own z ≤ 0. It stands still."""

KINDS = {
    HALF_SPACE: "plane",
    SPHERE: "sphere",
    CAPSULE: "capsule",
    ELLIPSOID: "ellipsoid",
    CYLINDER: "cylinder",
    BOX: "box",
    HULL: "mesh",
}
"""How an arm's file calls them."""


_ABSOLUTE, _RELATIVE = 1e-8, 2.0**-43  # [m], 1

TAPERED = 100
"""The hull of two balls, which MuJoCo has not: radius at −z, half of the axis, radius at +z."""


@leaf
def extent(
    kind: int, size: FloatArray, axes: FloatArray, corners: FloatArray, x: float, y: float, z: float
) -> float:
    """Return max n·y over a shape about its own origin, n = (x, y, z) a unit vector of the outer frame.

    ``axes`` (9,): outer_R_shape by rows; ``corners`` (m, 3) those of a hull, in its own frame. Of a
    half-space, which has no end but along its own z, see `height`.
    """
    a, b, c = turned_back(axes, x, y, z)
    if kind == SPHERE:
        return float(size[0])
    if kind == CAPSULE:
        return float(size[0] + size[1] * abs(c))
    if kind == CYLINDER:
        return float(size[0] * math.sqrt(a * a + b * b) + size[1] * abs(c))
    if kind == BOX:
        return float(size[0] * abs(a) + size[1] * abs(b) + size[2] * abs(c))
    if kind == ELLIPSOID:
        return math.sqrt((size[0] * a) ** 2 + (size[1] * b) ** 2 + (size[2] * c) ** 2)
    if kind == TAPERED:
        return float(max(size[0] - size[1] * c, size[2] + size[1] * c))
    most = -math.inf
    for i in range(corners.shape[0]):
        most = max(most, a * corners[i, 0] + b * corners[i, 1] + c * corners[i, 2])
    return most


@leaf
def _extent_of(bodies: Bodies, i: int, x: float, y: float, z: float) -> float:
    """Return `extent` of shape i."""
    corners = bodies.corners[bodies.firsts[i] : bodies.firsts[i + 1]]
    return extent(bodies.kinds[i], bodies.sizes[i], bodies.axes[i], corners, x, y, z)


@leaf
def height(bodies: Bodies, i: int, j: int) -> float:
    """Return shape j's distance from half-space i [m], negative: depth; exact in any configuration."""
    places, axes = bodies.places, bodies.axes
    x, y, z = axes[i, XZ], axes[i, YZ], axes[i, ZZ]
    dx, dy, dz = places[j, 0] - places[i, 0], places[j, 1] - places[i, 1], places[j, 2] - places[i, 2]
    below = _extent_of(bodies, j, -x, -y, -z)
    return float(dx * x + dy * y + dz * z - below)


@leaf
def slab(bodies: Bodies, i: int, j: int, x: float, y: float, z: float) -> float:
    """Return the width of the slab between shapes i and j across the unit vector (x, y, z) [m]; < 0: none."""
    places = bodies.places
    dx, dy, dz = places[j, 0] - places[i, 0], places[j, 1] - places[i, 1], places[j, 2] - places[i, 2]
    near, far = _extent_of(bodies, i, x, y, z), _extent_of(bodies, j, -x, -y, -z)
    return float(dx * x + dy * y + dz * z - near - far)


@leaf
def lower_gaps(
    bodies: Bodies,
    pairs: IntArray,
    chosen: IntArray,
    normals: FloatArray,
    enough: FloatArray,
    gaps: FloatArray,
) -> None:
    """Write a lower bound of the distance of every chosen pair into ``gaps`` (chosen,).

    Args:
        bodies: the shapes where they are.
        pairs: (p, 2) indices of two shapes.
        chosen: (m,) indices of pairs.
        normals: (p, 3) unit, from the first shape to the second; 0 where none is known.
        enough: (m,) where the balls' gap is as large [m], slabs are not checked.
        gaps: [m]: the larger one of the balls' gap and the slab's width; a half-space's is its `height`.
    """
    places, radii = bodies.places, bodies.radii
    for k in range(chosen.shape[0]):
        pair = chosen[k]
        i, j = pairs[pair, 0], pairs[pair, 1]
        if bodies.kinds[i] == HALF_SPACE:
            gaps[k] = height(bodies, i, j)
            continue
        dx, dy, dz = places[j, 0] - places[i, 0], places[j, 1] - places[i, 1], places[j, 2] - places[i, 2]
        gap = math.sqrt(dx * dx + dy * dy + dz * dz) - radii[i] - radii[j]
        x, y, z = normals[pair, 0], normals[pair, 1], normals[pair, 2]
        if gap < enough[k] and (x != 0.0 or y != 0.0 or z != 0.0):
            gap = max(gap, slab(bodies, i, j, x, y, z))
        gaps[k] = gap


@leaf
def rounding(i: int, j: int, places: FloatArray, radii: FloatArray) -> float:
    """Return what floating point may have taken from the distance of two shapes [m]: it grows with places.

    10⁻⁸ m, and 2⁻⁴³ (about a thousand roundings) of coordinates: a chain of seven joints takes some 150.
    """
    size = 0.0
    for k in range(3):
        size += abs(places[i, k]) + abs(places[j, k])
    if radii[i] < math.inf:
        size += radii[i]
    return float(_ABSOLUTE + _RELATIVE * (size + radii[j]))


@leaf
def farthest_moves(
    anchors: FloatArray,
    directions: FloatArray,
    places: FloatArray,
    radii: FloatArray,
    carried: IntArray,
    spins: IntArray,
    turns: FloatArray,
    moves: FloatArray,
) -> None:
    """Write how far any point of a shape can be moved by the joints from i on, into ``moves`` (g, n + 1).

    Let the joints turn one after the other, the last first, so that every axis is still where it was. With
    T the turn of joint j, and p″ where those after it have brought p: ‖Tp″ − p‖ ≤ ‖Tp″ − Tp‖ + ‖Tp − p‖ ≤
    ‖p″ − p‖ + r_j · turn_j, r_j the distance of p from the joint's axis. Summed: Σ r_j · turn_j.

    Args:
        anchors: (n, 3) points on the joints' axes [m].
        directions: (n, 3) unit, of the axes.
        places: (g, 3) shapes' origins [m].
        radii: (g,) of balls about them that hold the shapes [m].
        carried: (g,) how many joints carry the shape.
        spins: (g,) whether the last of them turns it about its own axis, so that it stays where it is.
        turns: (n,) how far each joint turns at most [rad].
        moves: [m]; 0 in the columns from ``carried`` on.
    """
    for g in range(places.shape[0]):
        for j in range(moves.shape[1] - 1, -1, -1):
            if j >= carried[g] or (j == carried[g] - 1 and spins[g]):
                moves[g, j] = 0.0
                continue
            x = places[g, 0] - anchors[j, 0]
            y = places[g, 1] - anchors[j, 1]
            z = places[g, 2] - anchors[j, 2]
            a, b, c = directions[j, 0], directions[j, 1], directions[j, 2]
            across = math.sqrt((y * c - z * b) ** 2 + (z * a - x * c) ** 2 + (x * b - y * a) ** 2)
            moves[g, j] = moves[g, j + 1] + turns[j] * (across + radii[g])


@leaf
def write_gap_slope(
    anchors: FloatArray,
    directions: FloatArray,
    carried: IntArray,
    pair: IntArray,
    fromto: FloatArray,
    normal: FloatArray,
    slope: FloatArray,
) -> None:
    """Write ∂gap/∂q (n,) [m/rad]: how the distance of the nearest points changes, n·(ẋ₂ − ẋ₁).

    Args:
        anchors: (n, 3) points on the joints' axes [m].
        directions: (n, 3) unit, of the axes.
        carried: (g,) how many joints carry each shape.
        pair: (2,) the two shapes.
        fromto: (6,) their nearest points [m].
        normal: (3,) unit, from the first to the second.
        slope: out.
    """
    for j in range(slope.shape[0]):
        slope[j] = 0.0
        for end in range(2):
            if j < carried[pair[end]]:
                x = fromto[3 * end] - anchors[j, 0]
                y = fromto[3 * end + 1] - anchors[j, 1]
                z = fromto[3 * end + 2] - anchors[j, 2]
                a, b, c = directions[j, 0], directions[j, 1], directions[j, 2]
                rate = normal[0] * (b * z - c * y) + normal[1] * (c * x - a * z) + normal[2] * (a * y - b * x)
                slope[j] += rate if end == 1 else -rate


@kernel
def middle_of_piece(piece: FloatArray, first: FloatArray, second: FloatArray, turns: FloatArray) -> None:
    """Halve a polynomial piece by de Casteljau; write how far it deviates from its middle at most.

    ``piece``, ``first``, ``second``: Bernstein coefficients (k + 1, n), of the halves in reading order; its
    middle is the last row of ``first``. ``turns`` (n,): the largest distance of a coefficient from the
    middle, which a polynomial cannot exceed.
    """
    rows, n = piece.shape
    work = piece.copy()
    for level in range(rows):
        for j in range(n):
            first[level, j] = work[0, j]
            second[rows - 1 - level, j] = work[rows - 1 - level, j]
        for i in range(rows - 1 - level):
            for j in range(n):
                work[i, j] = 0.5 * (work[i, j] + work[i + 1, j])
    for j in range(n):
        turns[j] = 0.0
        for i in range(rows):
            turns[j] = max(turns[j], abs(piece[i, j] - first[rows - 1, j]))


@kernel
def halves_of(pieces: FloatArray) -> FloatArray:
    """Return the Bernstein coefficients (2m, k + 1, n) of both halves of every piece (m, k + 1, n)."""
    m, rows, n = pieces.shape
    halves, turns = np.empty((2 * m, rows, n)), np.empty(n)
    for i in range(m):
        middle_of_piece(pieces[i], halves[2 * i], halves[2 * i + 1], turns)
    return halves
