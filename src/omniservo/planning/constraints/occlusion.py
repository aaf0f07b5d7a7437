"""Occlusion: no sphere between camera and target point.

The line of sight from t to h misses the ball (o, r) exactly when a plane at distance ≥ r from o has both of
its ends beyond it: e·(t − o) ≥ r and e·(h − o) ≥ r for one unit vector e. On a piece of the path e points
from o to the nearest point of the hull of h and the control points of t, which prove the rest, degree τ; one
plane may do for many points.
This equals A ≥ 0, C ≥ 0 and (B ≥ 0 or AC − B² ≥ 0) with A = ‖t−o‖²−r², B = (t−o)·(h−o)−r², C = ‖h−o‖²−r².
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
    MAX_PIECES,
    OPEN,
    PROVEN,
    Bounds,
    Piece,
    first_piece,
    subdivide,
)
from omniservo.planning.constraints.constraints import SPHERE_RADIUS, Constraints
from omniservo.planning.constraints.path_forms import PathForms
from omniservo.planning.constraints.place import TX, TY, TZ
from omniservo.planning.constraints.push import ASLEEP, Samples, push_centre_often
from omniservo.planning.constraints.visibility import sum_of_controls

_STEPS = 8
"""of Gilbert's algorithm; a plane that it does not find is found on half the piece"""


class _Sights(NamedTuple):
    """Lines of sight and the ball that is to leave them free."""

    points: FloatArray
    """Their far ends (n, 3) [m]."""
    o: FloatArray
    """The ball's centre, (3,) or longer [m]."""
    radius: float
    """[m]"""


@leaf
def sight_offset(
    tx: float, ty: float, tz: float, h: FloatArray, o: FloatArray
) -> tuple[float, float, float, float, float]:
    """Return q − o, q = t + s(h − t) the sight line's point nearest to o, its length, and s in [0, 1]."""
    return nearest_of_sight(tx - o[0], ty - o[1], tz - o[2], h[0] - tx, h[1] - ty, h[2] - tz)


@leaf
def nearest_of_sight(
    px: float, py: float, pz: float, lx: float, ly: float, lz: float
) -> tuple[float, float, float, float, float]:
    """Return the point p + s l, s in [0, 1], nearest to 0, its length, and s."""
    square = lx * lx + ly * ly + lz * lz
    s = -(px * lx + py * ly + pz * lz) / square if square > 0.0 else 0.0
    s = min(max(s, 0.0), 1.0)
    x, y, z = px + s * lx, py + s * ly, pz + s * lz
    return x, y, z, math.sqrt(x * x + y * y + z * z), s


@kernel
def prove_clear_sights(
    centre: FloatArray, size: float, points: FloatArray, o: FloatArray, radius: float
) -> tuple[int, float, int]:
    """Decide on [0, 1] whether the ball (o, radius) leaves the lines of sight from t(w) to all points free.

    Args:
        centre: control points of t (3, τ+1) with count τ + 2 and magnitude ``size``.
        size: see above.
        points: target points (n, 3) [m].
        o: centre of the ball, (3,) or longer.
        radius: [m].

    Returns:
        status; where it is not PROVEN also w and the point.
    """
    n, far = centre.shape[1] - 1, max(abs(o[0]), abs(o[1]), abs(o[2]))
    for j in range(points.shape[0]):
        far = max(far, abs(points[j, 0]), abs(points[j, 1]), abs(points[j, 2]))
    error = UNIT * (4.0 * (size + 2.0 * far) + abs(radius))
    pieces = first_piece(centre, np.empty((3, 0)), points.shape[0])
    bounds = Bounds(n + 20.0, float(n), error, MAX_LEVEL, MAX_PIECES)
    return subdivide(_sees_past, _Sights(points, o, radius), pieces, bounds)


@leaf
def _sees_past(piece: Piece, sights: _Sights) -> tuple[int, int]:
    """Show the lines of sight of a piece past the ball, or one from an end of it through the ball."""
    curve, o, n = piece.curve, sights.o, piece.curve.shape[1] - 1
    j = _hidden_point(curve, sights.points, o, sights.radius, piece.bound, piece.left)
    if j < 0:
        return HOLDS, 0
    h, least = sights.points[j], sights.radius - piece.bound
    if sight_offset(curve[0, 0], curve[1, 0], curve[2, 0], h, o)[3] < least:
        return FAILS_AT_START, j
    return (FAILS_AT_END if sight_offset(curve[0, n], curve[1, n], curve[2, n], h, o)[3] < least else OPEN), j


@leaf
def _hidden_point(
    piece: FloatArray, points: FloatArray, o: FloatArray, radius: float, bound: float, shown: IntArray
) -> int:
    """Mark points in ``shown`` as planes are found that keep them; return one that has none, or −1.

    The point whose line of sight comes nearest to the ball goes first: its plane keeps most others.
    """
    part, ox, oy, oz = 1.0 / piece.shape[1], o[0], o[1], o[2]
    mx, my, mz = sum_of_controls(piece)
    mx, my, mz = mx * part, my * part, mz * part
    while True:
        worst, least = -1, math.inf
        for j in range(points.shape[0]):
            if shown[j] == 0:
                lx, ly, lz = points[j, 0] - mx, points[j, 1] - my, points[j, 2] - mz
                distance = nearest_of_sight(mx - ox, my - oy, mz - oz, lx, ly, lz)[3]
                if not distance >= least:
                    worst, least = j, distance
        if worst < 0:
            return -1
        found, nx, ny, nz = plane_past_ball(piece, points[worst : worst + 1], o, radius, bound)
        if not found:
            return worst
        for j in range(points.shape[0]):
            if shown[j] == 0:
                x, y, z = points[j, 0] - ox, points[j, 1] - oy, points[j, 2] - oz
                along = (nx * x + ny * y + nz * z) * (1.0 - 2e-15)
                shown[j] = 1 if along - radius >= bound else 0


@leaf
def plane_past_ball(
    piece: FloatArray, points: FloatArray, o: FloatArray, radius: float, bound: float
) -> tuple[bool, float, float, float]:
    """Return whether a plane is found that keeps ``points`` (m, 3) and control points (3, n+1) off the ball.

    And its unit normal. It points to the hull's point nearest to o, approached by Gilbert's algorithm: step
    to the nearest point of the segment to the vertex that lies least far along.
    """
    n, m, ox, oy, oz = piece.shape[1], points.shape[0], o[0], o[1], o[2]
    mx, my, mz = sum_of_controls(piece)
    x, y, z = mx / n - ox, my / n - oy, mz / n - oz
    hx, hy, hz = points[0, 0] - ox, points[0, 1] - oy, points[0, 2] - oz
    x, y, z, distance, _ = nearest_of_sight(x, y, z, hx - x, hy - y, hz - z)
    for _ in range(_STEPS):
        if not distance > radius + bound:
            break
        fx, fy, fz = x / distance, y / distance, z / distance
        least, vx, vy, vz = math.inf, 0.0, 0.0, 0.0
        for k in range(n + m):
            px = (piece[0, k] if k < n else points[k - n, 0]) - ox
            py = (piece[1, k] if k < n else points[k - n, 1]) - oy
            pz = (piece[2, k] if k < n else points[k - n, 2]) - oz
            along = fx * px + fy * py + fz * pz
            if not along >= least:
                least, vx, vy, vz = along, px, py, pz
        if least * (1.0 - 2e-15) - radius >= bound:
            return True, fx, fy, fz
        vx, vy, vz = vx - x, vy - y, vz - z
        square = vx * vx + vy * vy + vz * vz
        s = min(max(-(x * vx + y * vy + z * vz) / square, 0.0), 1.0) if square > 0.0 else 0.0
        x, y, z = x + s * vx, y + s * vy, z + s * vz
        distance = math.sqrt(x * x + y * y + z * z)
    return False, 0.0, 0.0, 0.0


@late
def sight_margin(
    constraints: Constraints, index: int, pose: FloatArray, points: FloatArray
) -> tuple[float, int]:
    """Return what sphere ``index`` leaves to the lines of sight at a pose (14,), and to which point least."""
    o = constraints.obstacles[index]
    least, about = math.inf, 0
    for j in range(points.shape[0]):
        value = sight_offset(pose[TX], pose[TY], pose[TZ], points[j], o)[3]
        if value < least:
            least, about = value, j
    return least - float(o[SPHERE_RADIUS]), about


@late
def prove_sights(
    constraints: Constraints, index: int, margin: float, path: PathForms
) -> tuple[int, float, int]:
    """Decide the lines of sight past sphere ``index`` with ``margin`` to spare: status, w, point."""
    o = constraints.obstacles[index]
    return prove_clear_sights(path.centre, path.size, constraints.points, o, o[SPHERE_RADIUS] + margin)


@late
def prove_unoccluded(constraints: Constraints, path: PathForms) -> tuple[int, float]:
    """Decide every line of sight past every sphere; a sphere of radius 0 hides nothing."""
    for i in range(constraints.obstacles.shape[0]):
        if constraints.obstacles[i, SPHERE_RADIUS] > 0.0:
            status, w, _ = prove_sights(constraints, i, 0.0, path)
            if status != PROVEN:
                return status, w
    return PROVEN, 0.0


@late
def push_sights(constraints: Constraints, samples: Samples) -> None:
    """Push the lines of sight off the spheres: g = (distance − r)/max(r, ℓ/20) (see `push`).

    With the nearest point q = t + k(h − t): ∂‖q − o‖/∂t = (1 − k)(q − o)/‖q − o‖.
    """
    points, obstacles, ell, first = (
        constraints.points,
        constraints.obstacles,
        constraints.ell,
        constraints.slots.sights,
    )
    poses, targets, least = samples.poses, samples.targets, samples.least
    systems, costs = samples.systems, samples.costs
    for i in range(obstacles.shape[0]):
        group, radius = first + i, obstacles[i, SPHERE_RADIUS]
        if radius <= 0.0 or targets[group] == ASLEEP:
            continue
        ox, oy, oz, unit = obstacles[i, 0], obstacles[i, 1], obstacles[i, 2], max(radius, 0.05 * ell)
        target, lowest = targets[group], least[group]
        for s in range(poses.shape[0]):
            tx, ty, tz = poses[s, TX], poses[s, TY], poses[s, TZ]
            px, py, pz = tx - ox, ty - oy, tz - oz
            xx, xy, xz, yy, yz, zz = 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
            bx, by, bz, cost = 0.0, 0.0, 0.0, 0.0
            for j in range(points.shape[0]):
                lx, ly, lz = points[j, 0] - tx, points[j, 1] - ty, points[j, 2] - tz
                k = -(px * lx + py * ly + pz * lz) / max(lx * lx + ly * ly + lz * lz, 1e-300)
                k = min(max(k, 0.0), 1.0)
                x, y, z = px + k * lx, py + k * ly, pz + k * lz
                square = x * x + y * y + z * z
                far = radius + unit * max(target, lowest)
                if square >= far * far:
                    continue
                distance = math.sqrt(square)
                g = (distance - radius) / unit
                lowest = min(lowest, g)
                if g < target:
                    f, r = (1.0 - k) / (unit * max(distance, 1e-9 * unit)), target - g
                    x, y, z = f * x, f * y, f * z
                    xx, xy, xz, yy, yz, zz = (
                        xx + x * x,
                        xy + x * y,
                        xz + x * z,
                        yy + y * y,
                        yz + y * z,
                        zz + z * z,
                    )
                    bx, by, bz, cost = bx + x * r, by + y * r, bz + z * r, cost + 0.5 * r * r
            if cost > 0.0:
                push_centre_often(systems, costs, s, poses, (xx, xy, xz, yy, yz, zz), (bx, by, bz), cost)
        least[group] = lowest
