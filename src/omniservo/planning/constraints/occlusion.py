"""Occlusion: no sphere between camera and target point.

The line of sight from t to h misses the ball (o, r) exactly when a plane at distance ≥ r from o has both of
its ends beyond it: e·(t − o) ≥ r and e·(h − o) ≥ r for one unit vector e. On a piece of the path e points
from o to the nearest point of the line of sight from the piece's middle; the control points of t prove the
rest, degree τ. This equals A ≥ 0, C ≥ 0 and (B ≥ 0 or AC − B² ≥ 0) with A = ‖t−o‖²−r², B = (t−o)·(h−o)−r²,
C = ‖h−o‖²−r².
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
from omniservo.planning.constraints.push import push_centre
from omniservo.planning.constraints.visibility import sum_of_controls


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
def prove_clear_sight(
    centre: FloatArray, size: float, h: FloatArray, o: FloatArray, radius: float
) -> tuple[int, float]:
    """Decide on [0, 1] whether the ball (o, radius) leaves the line of sight from t(w) to h free.

    Args:
        centre: control points of t (3, τ+1) with count τ + 2 and magnitude ``size``.
        size: see above.
        h: target point (3,).
        o: centre of the ball, (3,) or longer.
        radius: [m].
    """
    n = centre.shape[1] - 1
    far = max(abs(o[0]), abs(o[1]), abs(o[2])) + max(abs(h[0]), abs(h[1]), abs(h[2]))
    error = UNIT * (4.0 * (size + far) + abs(radius))
    if sight_holds(centre, h, o, radius, (n + 20.0) * error + TINY):
        return PROVEN, 0.0
    stack = np.empty((MAX_LEVEL + 2, 3, n + 1))
    start = np.zeros(MAX_LEVEL + 2)
    level = np.zeros(MAX_LEVEL + 2, dtype=np.int64)
    copy_into(centre, stack[0])
    top, pieces = 0, 0
    while top >= 0:
        piece = stack[top]
        bound = (n + 20.0 + level[top] * n) * error + TINY
        if sight_holds(piece, h, o, radius, bound):
            top -= 1
            continue
        width = 0.5 ** level[top]
        for end in range(2):
            k = n * end
            if sight_offset(piece[0, k], piece[1, k], piece[2, k], h, o)[3] < radius - bound:
                return REFUTED, start[top] + width * end
        pieces += 1
        if level[top] == MAX_LEVEL or pieces > MAX_PIECES:
            return UNDECIDED, start[top]
        halve(piece, stack[top + 1], piece)
        start[top + 1] = start[top]
        start[top] += 0.5 * width
        level[top] += 1
        level[top + 1] = level[top]
        top += 1
    return PROVEN, 0.0


@kernel
def sight_holds(piece: FloatArray, h: FloatArray, o: FloatArray, radius: float, bound: float) -> bool:
    """Tell whether one plane separates the ball from h and from all control points."""
    n = piece.shape[1] - 1
    mx, my, mz = sum_of_controls(piece)
    part = 1.0 / (n + 1)
    x, y, z, distance, _ = sight_offset(mx * part, my * part, mz * part, h, o)
    if not distance > 0.0:
        return False
    f = (1.0 - 1e-15) / distance
    x, y, z = f * x, f * y, f * z
    if not x * (h[0] - o[0]) + y * (h[1] - o[1]) + z * (h[2] - o[2]) - radius >= bound:
        return False
    for k in range(n + 1):
        gap = x * (piece[0, k] - o[0]) + y * (piece[1, k] - o[1]) + z * (piece[2, k] - o[2]) - radius
        if not gap >= bound:
            return False
    return True


@kernel
def prove_unoccluded(
    centre: FloatArray, size: float, points: FloatArray, obstacles: FloatArray
) -> tuple[int, float]:
    """Decide every line of sight past every sphere; a sphere of radius 0 hides nothing."""
    for i in range(obstacles.shape[0]):
        if obstacles[i, 3] > 0.0:
            for j in range(points.shape[0]):
                status, w = prove_clear_sight(centre, size, points[j], obstacles[i], obstacles[i, 3])
                if status != PROVEN:
                    return status, w
    return PROVEN, 0.0


@kernel
def push_sight(
    points: FloatArray,
    obstacles: FloatArray,
    pose: FloatArray,
    ell: float,
    targets: FloatArray,
    least: FloatArray,
    system: FloatArray,
) -> float:
    """Push the lines of sight off the spheres: g = (distance − r)/max(r, ℓ/20) (see `push`).

    With the nearest point q = t + s(h − t): ∂‖q − o‖/∂t = (1 − s)(q − o)/‖q − o‖.
    """
    cost = 0.0
    for i in range(obstacles.shape[0]):
        radius = obstacles[i, 3]
        if radius <= 0.0:
            continue
        unit = max(radius, 0.05 * ell)
        for j in range(points.shape[0]):
            x, y, z, distance, s = sight_offset(pose[9], pose[10], pose[11], points[j], obstacles[i])
            g = (distance - radius) / unit
            least[i] = min(least[i], g)
            if g < targets[i]:
                f = (1.0 - s) / (unit * max(distance, 1e-9 * unit))
                cost += push_centre(system, pose, f * x, f * y, f * z, targets[i] - g)
    return cost
