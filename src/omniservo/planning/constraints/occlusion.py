"""Occlusion: no sphere between camera and target point.

The line of sight from t to h misses the ball (o, r) exactly when a plane at distance ≥ r from o has both of
its ends beyond it: e·(t − o) ≥ r and e·(h − o) ≥ r for one unit vector e. On a piece of the path e points
from o to the nearest point of the hull of h and the control points of t, which prove the rest, degree τ; one
plane may do for many points.
This equals A ≥ 0, C ≥ 0 and (B ≥ 0 or AC − B² ≥ 0) with A = ‖t−o‖²−r², B = (t−o)·(h−o)−r², C = ‖h−o‖²−r².
"""

import math

import numpy as np

from omniservo.geometry.arrays import FloatArray
from omniservo.geometry.kernel import kernel
from omniservo.geometry.polynomial import (
    MAX_LEVEL,
    MAX_PIECES,
    PROVEN,
    REFUTED,
    TINY,
    UNDECIDED,
    UNIT,
    copy_into,
    halve,
)
from omniservo.planning.constraints.push import ASLEEP, push_centre
from omniservo.planning.constraints.visibility import sum_of_controls

_STEPS = 8
"""of Gilbert's algorithm; a plane that it does not find is found on half the piece"""

_TOGETHER = 4
"""So often a piece is halved in the attempt to keep all lines of sight beyond one plane."""


@kernel
def sight_offset(
    tx: float, ty: float, tz: float, h: FloatArray, o: FloatArray
) -> tuple[float, float, float, float, float]:
    """Return q − o, q = t + s(h − t) the sight line's point nearest to o, its length, and s in [0, 1]."""
    lx, ly, lz = h[0] - tx, h[1] - ty, h[2] - tz
    px, py, pz = tx - o[0], ty - o[1], tz - o[2]
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

    First one plane a piece for all points, then, where that does not end, points one by one.

    Args:
        centre: control points of t (3, τ+1) with count τ + 2 and magnitude ``size``.
        size: see above.
        points: target points (n, 3) [m].
        o: centre of the ball, (3,) or longer.
        radius: [m].

    Returns:
        status; where it is not PROVEN also w and the point.
    """
    stack, marks = np.empty((MAX_LEVEL + 2, 3, centre.shape[1])), np.empty((MAX_LEVEL + 2, 2))
    status, w, j = _prove_sights(centre, size, points, o, radius, _TOGETHER, stack, marks)
    if status == UNDECIDED:
        for j in range(points.shape[0]):
            one = points[j : j + 1]
            status, w, _ = _prove_sights(centre, size, one, o, radius, MAX_LEVEL, stack, marks)
            if status != PROVEN:
                return status, w, j
    return status, w, j


@kernel
def _prove_sights(
    centre: FloatArray,
    size: float,
    points: FloatArray,
    o: FloatArray,
    radius: float,
    levels: int,
    stack: FloatArray,
    marks: FloatArray,
) -> tuple[int, float, int]:
    """Decide with one plane a piece for all ``points`` and at most ``levels`` halvings.

    ``stack`` (MAX_LEVEL + 2, 3, τ+1) and ``marks`` (MAX_LEVEL + 2, 2), start and level, are room for pieces.
    """
    n = centre.shape[1] - 1
    far = max(abs(o[0]), abs(o[1]), abs(o[2]))
    for j in range(points.shape[0]):
        far = max(far, abs(points[j, 0]), abs(points[j, 1]), abs(points[j, 2]))
    error = UNIT * (4.0 * (size + 2.0 * far) + abs(radius))
    copy_into(centre, stack[0])
    marks[0, 0], marks[0, 1] = 0.0, 0.0
    top, pieces = 0, 0
    while top >= 0:
        piece, level = stack[top], marks[top, 1]
        bound = (n + 20.0 + level * n) * error + TINY
        if sight_holds(piece, points, o, radius, bound):
            top -= 1
            continue
        width = 0.5**level
        for j in range(points.shape[0]):
            for k in (0, n):
                if sight_offset(piece[0, k], piece[1, k], piece[2, k], points[j], o)[3] < radius - bound:
                    return REFUTED, marks[top, 0] + (width if k > 0 else 0.0), j
        pieces += 1
        if level >= levels or pieces > MAX_PIECES:
            return UNDECIDED, marks[top, 0], 0
        halve(piece, stack[top + 1], piece)
        marks[top + 1, 0], marks[top + 1, 1] = marks[top, 0], level + 1.0
        marks[top, 0] += 0.5 * width
        marks[top, 1] = level + 1.0
        top += 1
    return PROVEN, 0.0, 0


@kernel
def sight_holds(piece: FloatArray, points: FloatArray, o: FloatArray, radius: float, bound: float) -> bool:
    """Tell whether one plane separates the ball from all ``points`` (m, 3) and all control points (3, n+1).

    Its normal points to the hull's point nearest to o, approached by Gilbert's algorithm: step to the nearest
    point of the segment to the vertex that lies least far along.
    """
    n, m = piece.shape[1], points.shape[0]
    x, y, z = sum_of_controls(piece)
    x, y, z = x / n, y / n, z / n
    x, y, z, distance, _ = sight_offset(x, y, z, points[0], o)
    for _ in range(_STEPS):
        if not distance > radius + bound:
            return False
        fx, fy, fz = x / distance, y / distance, z / distance
        least, vx, vy, vz = math.inf, 0.0, 0.0, 0.0
        for k in range(n + m):
            px = (piece[0, k] if k < n else points[k - n, 0]) - o[0]
            py = (piece[1, k] if k < n else points[k - n, 1]) - o[1]
            pz = (piece[2, k] if k < n else points[k - n, 2]) - o[2]
            along = (fx * px + fy * py + fz * pz) * (1.0 - 2e-15)
            if not along >= least:
                least, vx, vy, vz = along, px, py, pz
        if least - radius >= bound:
            return True
        vx, vy, vz = vx - x, vy - y, vz - z
        square = vx * vx + vy * vy + vz * vz
        s = min(max(-(x * vx + y * vy + z * vz) / square, 0.0), 1.0) if square > 0.0 else 0.0
        x, y, z = x + s * vx, y + s * vy, z + s * vz
        distance = math.sqrt(x * x + y * y + z * z)
    return False


@kernel
def prove_unoccluded(
    centre: FloatArray, size: float, points: FloatArray, obstacles: FloatArray
) -> tuple[int, float]:
    """Decide every line of sight past every sphere; a sphere of radius 0 hides nothing."""
    for i in range(obstacles.shape[0]):
        if obstacles[i, 3] > 0.0:
            status, w, _ = prove_clear_sights(centre, size, points, obstacles[i], obstacles[i, 3])
            if status != PROVEN:
                return status, w
    return PROVEN, 0.0


@kernel
def push_sight(
    points: FloatArray,
    obstacles: FloatArray,
    poses: FloatArray,
    ell: float,
    first: int,
    targets: FloatArray,
    least: FloatArray,
    systems: FloatArray,
    costs: FloatArray,
) -> None:
    """Push the lines of sight off the spheres: g = (distance − r)/max(r, ℓ/20) (see `push`).

    With the nearest point q = t + k(h − t): ∂‖q − o‖/∂t = (1 − k)(q − o)/‖q − o‖.
    """
    for i in range(obstacles.shape[0]):
        group, radius = first + i, obstacles[i, 3]
        if radius <= 0.0 or targets[group] == ASLEEP:
            continue
        ox, oy, oz, unit = obstacles[i, 0], obstacles[i, 1], obstacles[i, 2], max(radius, 0.05 * ell)
        for s in range(poses.shape[0]):
            tx, ty, tz = poses[s, 9], poses[s, 10], poses[s, 11]
            for j in range(points.shape[0]):
                lx, ly, lz = points[j, 0] - tx, points[j, 1] - ty, points[j, 2] - tz
                x, y, z = tx - ox, ty - oy, tz - oz
                k = -(x * lx + y * ly + z * lz) / max(lx * lx + ly * ly + lz * lz, 1e-300)
                k = min(max(k, 0.0), 1.0)
                x, y, z = x + k * lx, y + k * ly, z + k * lz
                square = x * x + y * y + z * z
                far = radius + unit * max(targets[group], least[group])
                if square >= far * far:
                    continue
                distance = math.sqrt(square)
                g = (distance - radius) / unit
                least[group] = min(least[group], g)
                if g < targets[group]:
                    f = (1.0 - k) / (unit * max(distance, 1e-9 * unit))
                    push_centre(systems, costs, s, poses, f * x, f * y, f * z, targets[group] - g)
