"""Boxes and capsules: separating planes, one for a piece of the path (convex hull property).

On [w₀, w₁] the path lies in the hull of its control points T_k there. Where one direction n has
n·T_k ≥ s(n) + d‖n‖ for all of them, s(n) = n·c + Σ e_k|n·a_k| + r‖n‖ the body's support, the camera centre
keeps the distance d. A line of sight from t to h is clear if n·T_k ≥ s(n) and n·h ≥ s(n). Pieces are halved
until each has its plane; the planes are the proof (docs/verification.md). Bodies: see `body_gap`.
"""

import math

import numpy as np

from omniservo.geometry.arrays import FloatArray
from omniservo.geometry.kernel import kernel
from omniservo.geometry.polynomial import MAX_LEVEL, PROVEN, REFUTED, TINY, UNDECIDED, UNIT, copy_into, halve
from omniservo.planning.constraints.body_gap import segment_gap
from omniservo.planning.constraints.push import ASLEEP, push_centre
from omniservo.planning.constraints.visibility import sum_of_controls

MOST_PLANES = 2000
"""A proof that needs more pieces stops as UNDECIDED."""

_STEPS = 4
"""of Gilbert's algorithm for a piece's plane; one that it does not find is found on half the piece"""


@kernel
def plane_of_piece(
    piece: FloatArray, h: FloatArray, body: FloatArray, reach: float, bound: float, normal: FloatArray
) -> bool:
    """Write the normal of a plane that keeps control points (3, n+1) and h (0 or 1, 3) off the body.

    False where none is found. Normals point from the body to the hull's point nearest to it, approached by
    Gilbert's algorithm: step to the nearest point of the segment to the vertex that lies least far along.
    """
    n = piece.shape[1]
    part = 1.0 / n
    mx, my, mz = sum_of_controls(piece)
    x, y, z = mx * part, my * part, mz * part
    vx, vy, vz = x, y, z
    if h.shape[0] > 0:
        vx, vy, vz = h[0, 0], h[0, 1], h[0, 2]
    for _ in range(_STEPS):
        nx, ny, nz, gap, s = segment_gap(body, x, y, z, vx, vy, vz)
        if not gap >= reach + bound:
            return False
        x, y, z = x + s * (vx - x), y + s * (vy - y), z + s * (vz - z)
        least = math.inf
        for k in range(n + h.shape[0]):
            px = h[0, 0] if k == n else piece[0, k]
            py = h[0, 1] if k == n else piece[1, k]
            pz = h[0, 2] if k == n else piece[2, k]
            along = nx * (px - body[0]) + ny * (py - body[1]) + nz * (pz - body[2])
            if not along >= least:
                least, vx, vy, vz = along, px, py, pz
        support = 0.0
        for a in range(3):
            i = 3 + 3 * a
            support += body[12 + a] * abs(nx * body[i] + ny * body[i + 1] + nz * body[i + 2])
        if least - support - reach >= bound:
            normal[0], normal[1], normal[2] = nx, ny, nz
            return True
    return False


@kernel
def separate(
    centre: FloatArray, size: float, h: FloatArray, body: FloatArray, reach: float, planes: FloatArray
) -> tuple[int, float, int]:
    """Decide whether path, or lines of sight from it, stay ``reach`` away from the body's box on [0, 1].

    Args:
        centre: control points of t (3, τ+1) with count τ + 2 and magnitude ``size``.
        size: see above.
        h: the target point at the other end (1, 3), or (0, 3): the path alone.
        body: (17,), see `body_gap`.
        reach: distance to keep from the box [m].
        planes: a row (w₀, w₁, n) for each piece is written here as far as there is room, (…, 5).

    Returns:
        status, the w where it fails, and the number of pieces.
    """
    n = centre.shape[1] - 1
    far = abs(body[0]) + abs(body[1]) + abs(body[2]) + body[12] + body[13] + body[14]
    if h.shape[0] > 0:
        far += max(abs(h[0, 0]), abs(h[0, 1]), abs(h[0, 2]))
    error = UNIT * (2.0 * size + far + abs(reach))
    stack = np.empty((MAX_LEVEL + 2, 3, n + 1))
    start = np.zeros(MAX_LEVEL + 2)
    level = np.zeros(MAX_LEVEL + 2, dtype=np.int64)
    normal = np.empty(3)
    copy_into(centre, stack[0])
    top, count = 0, 0
    while top >= 0:
        piece, width = stack[top], 0.5 ** level[top]
        bound = (2.0 * n * (1.0 + level[top]) + 60.0) * error + TINY
        if plane_of_piece(piece, h, body, reach, bound, normal):
            if count < planes.shape[0]:
                planes[count, 0], planes[count, 1] = start[top], start[top] + width
                planes[count, 2], planes[count, 3], planes[count, 4] = normal[0], normal[1], normal[2]
            count += 1
            top -= 1
            continue
        for end in range(2):
            if distance_at(piece, n * end, h, body) < reach - bound:
                return REFUTED, start[top] + width * end, count
        if level[top] == MAX_LEVEL or count + top >= MOST_PLANES:
            return UNDECIDED, start[top], count
        halve(piece, stack[top + 1], piece)
        start[top + 1] = start[top]
        start[top] += 0.5 * width
        level[top] += 1
        level[top + 1] = level[top]
        top += 1
    return PROVEN, 0.0, count


@kernel
def distance_at(piece: FloatArray, k: int, h: FloatArray, body: FloatArray) -> float:
    """Return the distance of control point k, or of its line of sight, to the body's box; negative: depth."""
    x, y, z = piece[0, k], piece[1, k], piece[2, k]
    if h.shape[0] > 0:
        return float(segment_gap(body, x, y, z, h[0, 0], h[0, 1], h[0, 2])[3])
    return float(segment_gap(body, x, y, z, x, y, z)[3])


@kernel
def prove_bodies_clear(
    centre: FloatArray, size: float, bodies: FloatArray, points: FloatArray
) -> tuple[int, float]:
    """Decide the clearance of every body and, past each body, the lines of sight to ``points``."""
    planes = np.empty((0, 5))
    for i in range(bodies.shape[0]):
        body = bodies[i]
        status, w, _ = separate(centre, size, points[:0], body, body[16], planes)
        if status != PROVEN:
            return status, w
        for j in range(points.shape[0]):
            status, w, _ = separate(centre, size, points[j : j + 1], body, body[15], planes)
            if status != PROVEN:
                return status, w
    return PROVEN, 0.0


@kernel
def push_off_bodies(
    bodies: FloatArray,
    points: FloatArray,
    poses: FloatArray,
    ell: float,
    first: int,
    targets: FloatArray,
    least: FloatArray,
    systems: FloatArray,
    costs: FloatArray,
) -> None:
    """Push the centre off the bodies, then its lines of sight to ``points`` (n, 3) (see `push`).

    g = (gap − reach)/max(reach, ℓ/20) with the gap of `segment_gap` and its nearest part s:
    ∂g/∂t = (1 − s) n. Groups: every body's clearance, then every body's sights, whose reach is the radius.
    """
    m = bodies.shape[0]
    for i in range(m):
        body = bodies[i]
        for kind in range(2 if points.shape[0] > 0 else 1):
            group, reach = first + i + m * kind, body[16 - kind]
            if targets[group] == ASLEEP:
                continue
            unit = max(reach, 0.05 * ell)
            for s in range(poses.shape[0]):
                x, y, z = poses[s, 9], poses[s, 10], poses[s, 11]
                for j in range(points.shape[0] if kind == 1 else 1):
                    hx, hy, hz = x, y, z
                    if kind == 1:
                        hx, hy, hz = points[j, 0], points[j, 1], points[j, 2]
                    nx, ny, nz, gap, part = segment_gap(body, x, y, z, hx, hy, hz)
                    g = (gap - reach) / unit
                    least[group] = min(least[group], g)
                    if g < targets[group]:
                        f = (1.0 - part) / unit
                        push_centre(systems, costs, s, poses, f * nx, f * ny, f * nz, targets[group] - g)
