"""Bodies, and all that moves: separating planes, one for a piece of the path (convex hull property).

On [w₀, w₁] the path lies in the hull of its control points T_k there. Where one direction n has
n·T_k ≥ s(n) + d‖n‖ for all of them, s(n) the body's support (of a box or capsule n·c + Σ e_k|n·a_k| + r‖n‖,
of a cylinder n·c + e₁|n·a₁| + e₂ √((n·a₂)² + (n·a₃)²), of an ellipsoid n·c + √Σ(e_k n·a_k)², of a mesh
max n·v), the camera centre keeps the distance d. A line of sight from t to h is clear if
n·T_k ≥ s(n) and n·h ≥ s(n). Of a body that moves T_k are the control points of t − m and h those of h − m,
all beyond the plane (`motion`). Pieces are halved until each has its plane; the planes are the proof
(docs/verification.md). Bodies: see `solid_gap`.
"""

import math
from typing import NamedTuple

import numpy as np

from omniservo.geometry.arrays import FloatArray, IntArray
from omniservo.geometry.kernel import kernel, late, leaf
from omniservo.geometry.polynomial import UNIT
from omniservo.geometry.subdivision import (
    FAILS_AT_END,
    FAILS_AT_START,
    HOLDS,
    MAX_LEVEL,
    OPEN,
    PROVEN,
    Bounds,
    Piece,
    first_piece,
    subdivide,
)
from omniservo.planning.constraints.body_gap import EXTENT, MOTION, RADIUS, REACH, is_solid
from omniservo.planning.constraints.constraints import Constraints
from omniservo.planning.constraints.hull_gap import Hull
from omniservo.planning.constraints.motion import displacement, point_from_body, seen_from_body
from omniservo.planning.constraints.path_forms import PathForms
from omniservo.planning.constraints.place import AT, TX, TY, TZ
from omniservo.planning.constraints.push import ASLEEP, Samples, push_centre
from omniservo.planning.constraints.solid_gap import core_support, hull_of, solid_gap
from omniservo.planning.constraints.visibility import sum_of_controls

MOST_PLANES = 2000
"""A proof that needs more pieces stops as UNDECIDED."""

_STEPS = 4
"""of Gilbert's algorithm for a piece's plane; one that it does not find is found on half the piece"""


class _Body(NamedTuple):
    """A body to keep off, and where the planes that show it are written."""

    numbers: FloatArray
    """(25,), see `body_gap`."""
    hull: Hull
    reach: float
    """[m]"""
    planes: FloatArray
    """(…, 5)"""
    written: IntArray
    """How many there are (1,)."""
    normal: FloatArray
    """Room for a normal (3,)."""


@leaf
def plane_of_piece(
    piece: FloatArray,
    h: FloatArray,
    body: FloatArray,
    hull: Hull,
    reach: float,
    bound: float,
    normal: FloatArray,
) -> bool:
    """Write the normal of a plane that keeps control points (3, n+1) and h (3, k+1 or 0) off the body.

    False where none is found. Normals point from the body to the hull's point nearest to it, approached by
    Gilbert's algorithm: step to the nearest point of the segment to the vertex that lies least far along.
    """
    n = piece.shape[1]
    part = 1.0 / n
    mx, my, mz = sum_of_controls(piece)
    x, y, z = mx * part, my * part, mz * part
    vx, vy, vz = x, y, z
    if h.shape[1] > 0:
        vx, vy, vz = h[0, 0], h[1, 0], h[2, 0]
    for _ in range(_STEPS):
        nx, ny, nz, gap, s = solid_gap(body, hull, x, y, z, vx, vy, vz)
        if not gap >= reach + bound:
            return False
        x, y, z = x + s * (vx - x), y + s * (vy - y), z + s * (vz - z)
        least = math.inf
        for k in range(n + h.shape[1]):
            px = piece[0, k] if k < n else h[0, k - n]
            py = piece[1, k] if k < n else h[1, k - n]
            pz = piece[2, k] if k < n else h[2, k - n]
            along = nx * (px - body[0]) + ny * (py - body[1]) + nz * (pz - body[2])
            if not along >= least:
                least, vx, vy, vz = along, px, py, pz
        if least - core_support(body, hull, nx, ny, nz) - reach >= bound:
            normal[0], normal[1], normal[2] = nx, ny, nz
            return True
    return False


@kernel
def separate(
    centre: FloatArray,
    size: float,
    h: FloatArray,
    body: FloatArray,
    hulls: Hull,
    reach: float,
    planes: FloatArray,
) -> tuple[int, float, int]:
    """Decide whether path, or lines of sight from it, stay ``reach`` away from the body's core on [0, 1].

    Args:
        centre: control points of t, or t − m (3, n+1), from `seen_from_body`.
        size: their magnitude.
        h: control points of the other end of the lines of sight (3, k+1), from `point_from_body`; (3, 0): the
            path alone.
        body: (25,), see `body_gap`.
        hulls: of all meshes.
        reach: distance to keep from the core [m].
        planes: a row (w₀, w₁, n) for each piece is written here as far as there is room, (…, 5).

    Returns:
        status, the w where it fails, and the number of pieces.
    """
    if reach <= 0.0 and not is_solid(body):
        return PROVEN, 0.0, 0
    n = max(centre.shape[1], h.shape[1]) - 1
    error = UNIT * (2.0 * size + _extent(body, h) + abs(reach))
    # Control points, and the plane's test of them, round in two places each (docs/certificate.md).
    bounds = Bounds(2.0 * n + 60.0, 2.0 * n, error, MAX_LEVEL, MOST_PLANES)
    count = np.zeros(1, dtype=np.int64)
    data = _Body(body, hull_of(body, hulls), reach, planes, count, np.empty(3))
    status, w, _ = subdivide(_has_plane, data, first_piece(centre, h, 0), bounds)
    return status, w, count[0]


@kernel
def _has_plane(piece: Piece, body: _Body) -> tuple[int, int]:
    """Show a piece beyond a plane off the body, which is written down, or an end of it too near the body."""
    curve, ends, normal, hull = piece.curve, piece.ends, body.normal, body.hull
    if plane_of_piece(curve, ends, body.numbers, hull, body.reach, piece.bound, normal):
        count, planes = body.written[0], body.planes
        if count < planes.shape[0]:
            planes[count, 0], planes[count, 1] = piece.start, piece.start + piece.width
            planes[count, 2], planes[count, 3], planes[count, 4] = normal[0], normal[1], normal[2]
        body.written[0] = count + 1
        return HOLDS, 0
    if distance_at(curve, ends, 0, body.numbers, hull) < body.reach - piece.bound:
        return FAILS_AT_START, 0
    at_end = distance_at(curve, ends, 1, body.numbers, hull)
    return (FAILS_AT_END if at_end < body.reach - piece.bound else OPEN), 0


@leaf
def _extent(body: FloatArray, h: FloatArray) -> float:
    """Return the part of the magnitude that comes from the body and the far ends h (3, k+1 or 0)."""
    far = 0.0
    for c in range(3):
        for k in range(h.shape[1]):
            far = max(far, abs(h[c, k]))
    return float(
        far + abs(body[0]) + abs(body[1]) + abs(body[2]) + body[EXTENT] + body[EXTENT + 1] + body[EXTENT + 2]
    )


@leaf
def distance_at(piece: FloatArray, h: FloatArray, end: int, body: FloatArray, hull: Hull) -> float:
    """Return the distance of one end (0 or 1) of a piece, or of its line of sight, to the body's core.

    Negative: the depth.
    """
    k, j = end * (piece.shape[1] - 1), end * (h.shape[1] - 1)
    x, y, z = piece[0, k], piece[1, k], piece[2, k]
    if h.shape[1] > 0:
        return float(solid_gap(body, hull, x, y, z, h[0, j], h[1, j], h[2, j])[3])
    return float(solid_gap(body, hull, x, y, z, x, y, z)[3])


@late
def prove_body_clear(
    constraints: Constraints, index: int, margin: float, path: PathForms
) -> tuple[int, float, int]:
    """Decide the clearance of body ``index`` with ``margin`` to spare: status, w, 0."""
    body, planes = constraints.bodies[index], np.empty((0, 5))
    centre, size = seen_from_body(path.centre, path.translation, path.size, constraints.motions, body[MOTION])
    status, w, _ = separate(
        centre, size, np.empty((3, 0)), body, constraints.hulls, body[REACH] + margin, planes
    )
    return status, w, 0


@late
def prove_sights_past_body(
    constraints: Constraints, index: int, margin: float, path: PathForms
) -> tuple[int, float, int]:
    """Decide the lines of sight past body ``index`` with ``margin`` to spare: status, w, target point."""
    body, motions, planes = constraints.bodies[index], constraints.motions, np.empty((0, 5))
    centre, size = seen_from_body(path.centre, path.translation, path.size, motions, body[MOTION])
    for j in range(constraints.points.shape[0]):
        h = point_from_body(constraints.points[j], motions, body[MOTION])
        status, w, _ = separate(centre, size, h, body, constraints.hulls, body[RADIUS] + margin, planes)
        if status != PROVEN:
            return status, w, j
    return PROVEN, 0.0, 0


@late
def prove_bodies_clear(constraints: Constraints, path: PathForms) -> tuple[int, float]:
    """Decide the clearance of every body and, where obstacles hide points, the lines of sight past it."""
    for i in range(constraints.bodies.shape[0]):
        status, w, _ = prove_body_clear(constraints, i, 0.0, path)
        if status == PROVEN and constraints.occlusion:
            status, w, _ = prove_sights_past_body(constraints, i, 0.0, path)
        if status != PROVEN:
            return status, w
    return PROVEN, 0.0


@late
def body_margin(constraints: Constraints, index: int, pose: FloatArray) -> float:
    """Return what the clearance of body ``index`` leaves at a pose (14,)."""
    body = constraints.bodies[index]
    mx, my, mz = displacement(constraints.motions, body[MOTION], pose[AT])
    x, y, z = pose[TX] - mx, pose[TY] - my, pose[TZ] - mz
    return float(solid_gap(body, hull_of(body, constraints.hulls), x, y, z, x, y, z)[3] - body[REACH])


@late
def body_sight_margin(
    constraints: Constraints, index: int, pose: FloatArray, points: FloatArray
) -> tuple[float, int]:
    """Return what body ``index`` leaves to the lines of sight at a pose (14,), and to which point least."""
    body = constraints.bodies[index]
    hull = hull_of(body, constraints.hulls)
    mx, my, mz = displacement(constraints.motions, body[MOTION], pose[AT])
    x, y, z = pose[TX] - mx, pose[TY] - my, pose[TZ] - mz
    least, about = math.inf, 0
    for j in range(points.shape[0]):
        hx, hy, hz = points[j, 0] - mx, points[j, 1] - my, points[j, 2] - mz
        value = solid_gap(body, hull, x, y, z, hx, hy, hz)[3]
        if value < least:
            least, about = value, j
    return least - float(body[RADIUS]), about


@late
def push_off_bodies(constraints: Constraints, samples: Samples) -> None:
    """Push the centre off the bodies, and its lines of sight to the target points (see `push`).

    g = (gap − reach)/max(reach, ℓ/20) with the gap of `solid_gap` and its nearest part s:
    ∂g/∂t = (1 − s) n. The reach of a line of sight is the body's radius.
    """
    poses, targets, least = samples.poses, samples.targets, samples.least
    systems, costs = samples.systems, samples.costs
    bodies, motions, points = constraints.bodies, constraints.motions, constraints.points
    for i in range(bodies.shape[0]):
        body, hull = bodies[i], hull_of(bodies[i], constraints.hulls)
        for kind in range(2 if constraints.occlusion else 1):
            group = (constraints.slots.bodies if kind == 0 else constraints.slots.body_sights) + i
            reach = body[REACH] if kind == 0 else body[RADIUS]
            if targets[group] == ASLEEP or (reach <= 0.0 and not is_solid(body)):
                continue
            unit = max(reach, 0.05 * constraints.ell)
            for s in range(poses.shape[0]):
                mx, my, mz = displacement(motions, body[MOTION], poses[s, AT])
                x, y, z = poses[s, TX] - mx, poses[s, TY] - my, poses[s, TZ] - mz
                for j in range(points.shape[0] if kind == 1 else 1):
                    hx, hy, hz = x, y, z
                    if kind == 1:
                        hx, hy, hz = points[j, 0] - mx, points[j, 1] - my, points[j, 2] - mz
                    nx, ny, nz, gap, part = solid_gap(body, hull, x, y, z, hx, hy, hz)
                    g = (gap - reach) / unit
                    least[group] = min(least[group], g)
                    if g < targets[group]:
                        f = (1.0 - part) / unit
                        push_centre(systems, costs, s, poses, f * nx, f * ny, f * nz, targets[group] - g)
