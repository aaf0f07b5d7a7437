"""Occlusion: no sphere between camera and target point.

The line of sight from t to h misses the ball (o, r) exactly when a plane at distance ≥ r from o has both of
its ends beyond it: e·(t − o) ≥ r and e·(h − o) ≥ r for one unit vector e. On a piece of the path e points
from o to the nearest point of the hull of h and the control points of t, which prove the rest, degree τ.
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

_STEPS = 6
"""of Gilbert's algorithm; a plane that it does not find is found on half the piece"""


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
    """Tell whether one plane separates the ball from h and from all control points (3, n+1).

    Its normal points to the hull's point nearest to o, approached by Gilbert's algorithm: step to the nearest
    point of the segment to the vertex that lies least far along.
    """
    n = piece.shape[1]
    part = 1.0 / n
    mx, my, mz = sum_of_controls(piece)
    x, y, z, distance, _ = sight_offset(mx * part, my * part, mz * part, h, o)
    for _ in range(_STEPS):
        if not distance > radius + bound:
            return False
        f = (1.0 - 1e-15) / distance
        least, vx, vy, vz = math.inf, 0.0, 0.0, 0.0
        for k in range(n + 1):
            px = (h[0] if k == n else piece[0, k]) - o[0]
            py = (h[1] if k == n else piece[1, k]) - o[1]
            pz = (h[2] if k == n else piece[2, k]) - o[2]
            along = f * x * px + f * y * py + f * z * pz
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
            for j in range(points.shape[0]):
                status, w = prove_clear_sight(centre, size, points[j], obstacles[i], obstacles[i, 3])
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
