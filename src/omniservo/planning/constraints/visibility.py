"""Visibility: every image limit is a cone n·c ≤ κ‖c‖ about a fixed axis (method: image limits are cones).

Proof on a piece of the path with control points C₀ … C_d of c(w), d = 2σ + τ:

- κ < 0: the limit is a convex cone; the piece lies inside when every control point does.
- κ ≥ 0: the limit is the outside of a convex cap. ‖c‖ ≥ e·c for every ‖e‖ ≤ 1, so (n − κe)·Cₖ ≤ 0 for all k
  suffices; e is the mean bearing of the piece, or that of the control point with the least left.

Either way the bound gets exact quadratically as pieces are halved, so the proof ends for every path that
keeps the limit strictly.
"""

import math

import numpy as np

from omniservo.geometry.arrays import FloatArray, IntArray
from omniservo.geometry.kernel import kernel, leaf
from omniservo.geometry.polynomial import (
    MAX_LEVEL,
    MAX_PIECES,
    PROVEN,
    REFUTED,
    TINY,
    UNDECIDED,
    copy_into,
    halve,
)
from omniservo.planning.constraints.dead_zone import Limit, disc_size, tangent_limit
from omniservo.planning.constraints.push import ASLEEP, push_camera_point

TEST_COUNT = 14
"""Roundings of one test of a control point against a limit, those of n, κ and e included."""

OUTSIDE = -1e6
"""What an image limit leaves to a point outside the model's domain [px]."""


@kernel
def prove_visible(
    controls: FloatArray, errors: FloatArray, count: float, limits: FloatArray, disc: FloatArray
) -> tuple[int, float, int, int]:
    """Decide every limit and the dead zone for every point on [0, 1].

    Args:
        controls: c(w) of every point (n, 3, d+1), from `camera_controls`.
        errors: their error per count (n,).
        count: their count.
        limits: (k, 4).
        disc: (7,), or (0,) where there is no dead zone; its proof takes D > 0 from the domain's limit.

    Returns:
        status, and where it is not PROVEN: w, the point, the limit (k means the dead zone).
    """
    degree = controls.shape[2] - 1
    k = limits.shape[0]
    sizes = np.empty(k + 1)
    for i in range(k):
        sizes[i] = abs(limits[i, 0]) + abs(limits[i, 1]) + abs(limits[i, 2]) + 3.0 * abs(limits[i, 3])
    sizes[k] = disc_size(disc) if disc.shape[0] > 0 else 0.0
    stack, start = np.empty((MAX_LEVEL + 2, 3, degree + 1)), np.empty(MAX_LEVEL + 2)
    level, first = np.empty(MAX_LEVEL + 2, dtype=np.int64), np.empty(MAX_LEVEL + 2, dtype=np.int64)
    for j in range(controls.shape[0]):
        copy_into(controls[j], stack[0])
        start[0], level[0], first[0] = 0.0, 0, 0
        status, w, i = _prove_point(stack, start, level, first, errors[j], count, limits, disc, sizes)
        if status != PROVEN:
            return status, w, j, i
    return PROVEN, 0.0, 0, 0


@leaf
def _prove_point(
    stack: FloatArray,
    start: FloatArray,
    level: IntArray,
    first: IntArray,
    error: float,
    count: float,
    limits: FloatArray,
    disc: FloatArray,
    sizes: FloatArray,
) -> tuple[int, float, int]:
    """Decide every limit for the point whose control points are ``stack[0]``.

    A piece of the stack has its start, its level (how often halved) and the first limit not yet proven on it.
    """
    degree = stack.shape[2] - 1
    top, pieces = 0, 0
    while top >= 0:
        piece = stack[top]
        bound = (count + TEST_COUNT + level[top] * degree) * error
        failing, side = _first_failing(piece, limits, disc, first[top], bound, sizes)
        if failing < 0:
            top -= 1
            continue
        width = 0.5 ** level[top]
        if side != 0:
            return REFUTED, start[top] + (width if side == 2 else 0.0), failing
        pieces += 1
        if level[top] == MAX_LEVEL or pieces > MAX_PIECES:
            return UNDECIDED, start[top], failing
        halve(piece, stack[top + 1], piece)
        start[top + 1] = start[top]
        start[top] += 0.5 * width
        level[top] += 1
        level[top + 1] = level[top]
        first[top] = failing
        first[top + 1] = failing
        top += 1
    return PROVEN, 0.0, 0


@kernel
def _first_failing(
    piece: FloatArray, limits: FloatArray, disc: FloatArray, first: int, bound: float, sizes: FloatArray
) -> tuple[int, int]:
    """Return the first limit from ``first`` on that this piece does not show to hold, or −1.

    And 1 or 2 where the piece's start or end shows that the limit is violated, else 0.
    """
    n = piece.shape[1] - 1
    mx, my, mz = sum_of_controls(piece)
    norm = math.sqrt(mx * mx + my * my + mz * mz)
    shorter = (1.0 - 1e-15) / norm if norm > 0.0 else 0.0
    ex, ey, ez = mx * shorter, my * shorter, mz * shorter
    rows = limits.shape[0]
    for i in range(first, rows):
        allowed = bound * float(sizes[i]) + TINY
        limit = (limits[i, 0], limits[i, 1], limits[i, 2], limits[i, 3])
        if cone_holds(piece, limit, ex, ey, ez, allowed):
            continue
        if not holds_by_tightest(piece, limit, allowed):
            return i, _violated_end(piece, limit, allowed)
    if disc.shape[0] > 0:
        allowed = bound * float(sizes[rows]) + TINY
        if not cone_holds(piece, tangent_limit(disc, mx, my, mz), ex, ey, ez, allowed):
            for end in range(2):
                k = n * end
                tangent = tangent_limit(disc, piece[0, k], piece[1, k], piece[2, k])
                if cone_value(piece, tangent, k) > allowed:
                    return rows, 1 + end
            return rows, 0
    return -1, 0


@leaf
def sum_of_controls(piece: FloatArray) -> tuple[float, float, float]:
    """Return the sum of the control points (3, n+1): it points where the piece is on average."""
    x, y, z = 0.0, 0.0, 0.0
    for k in range(piece.shape[1]):
        x += piece[0, k]
        y += piece[1, k]
        z += piece[2, k]
    return x, y, z


@leaf
def cone_holds(piece: FloatArray, limit: Limit, ex: float, ey: float, ez: float, bound: float) -> bool:
    """Tell whether the control points show n·c ≤ κ‖c‖ on the whole piece; ‖(ex, ey, ez)‖ ≤ 1."""
    nx, ny, nz, kappa = limit
    x, y, z = nx - kappa * ex, ny - kappa * ey, nz - kappa * ez
    held = 0
    for k in range(piece.shape[1]):
        if kappa < 0.0:
            held += cone_value(piece, limit, k) <= -bound
        else:
            held += x * piece[0, k] + y * piece[1, k] + z * piece[2, k] <= -bound
    return bool(held == piece.shape[1])


@leaf
def holds_by_tightest(piece: FloatArray, limit: Limit, bound: float) -> bool:
    """Try the bearing of the control point with the least left: exact where an end of the piece is it."""
    tightest, most = 0, -math.inf
    for k in range(piece.shape[1]):
        value = cone_value(piece, limit, k)
        if value > most:
            tightest, most = k, value
    if most > -bound:
        return False
    x, y, z = piece[0, tightest], piece[1, tightest], piece[2, tightest]
    norm = math.sqrt(x * x + y * y + z * z)
    shorter = (1.0 - 1e-15) / norm if norm > 0.0 else 0.0
    return cone_holds(piece, limit, x * shorter, y * shorter, z * shorter, bound)


@leaf
def _violated_end(piece: FloatArray, limit: Limit, bound: float) -> int:
    """Return 1 or 2 where n·c > κ‖c‖ beyond rounding at the start or end of the piece, else 0."""
    if cone_value(piece, limit, 0) > bound:
        return 1
    return 2 if cone_value(piece, limit, piece.shape[1] - 1) > bound else 0


@leaf
def cone_value(piece: FloatArray, limit: Limit, k: int) -> float:
    """Return n·C − κ‖C‖ of control point k."""
    nx, ny, nz, kappa = limit
    x, y, z = float(piece[0, k]), float(piece[1, k]), float(piece[2, k])
    return nx * x + ny * y + nz * z - kappa * math.sqrt(x * x + y * y + z * z)


@leaf
def push_into_image(
    limits: FloatArray,
    disc: FloatArray,
    camera_points: FloatArray,
    targets: FloatArray,
    least: FloatArray,
    systems: FloatArray,
    costs: FloatArray,
) -> None:
    """Push every point into the image: g = κ − n·b, b = c/‖c‖, ∂g/∂c = −(n − (n·b) b)/‖c‖ (see `push`).

    Args:
        limits: (k, 4), n of unit length.
        disc: dead zone; its limit at a point is the tangent that faces the point, scaled to unit n.
        camera_points: c and 1/‖c‖ (s, n, 4).
        targets: μ; the first k are the limits', the next the dead zone's.
        least: smallest g so far.
        systems: see `push`.
        costs: see `push`.
    """
    rows = limits.shape[0]
    for i in range(rows):
        if targets[i] == ASLEEP:
            continue
        nx, ny, nz, kappa = limits[i, 0], limits[i, 1], limits[i, 2], limits[i, 3]
        target, lowest = targets[i], least[i]
        for s in range(camera_points.shape[0]):
            for j in range(camera_points.shape[1]):
                x, y, z = camera_points[s, j, 0], camera_points[s, j, 1], camera_points[s, j, 2]
                inverse = camera_points[s, j, 3]
                along = (nx * x + ny * y + nz * z) * inverse
                g = kappa - along
                if g < lowest:
                    lowest = g
                if g < target:
                    f = along * inverse
                    gx, gy, gz = inverse * (f * x - nx), inverse * (f * y - ny), inverse * (f * z - nz)
                    push_camera_point(systems, costs, s, x, y, z, gx, gy, gz, target - g)
        least[i] = lowest
    if disc.shape[0] > 0 and targets[rows] != ASLEEP:
        _push_off_disc(disc, camera_points, rows, targets, least, systems, costs)


@kernel
def _push_off_disc(
    disc: FloatArray,
    camera_points: FloatArray,
    group: int,
    targets: FloatArray,
    least: FloatArray,
    systems: FloatArray,
    costs: FloatArray,
) -> None:
    """Push every point off the dead zone, by the tangent that faces it."""
    for s in range(camera_points.shape[0]):
        for j in range(camera_points.shape[1]):
            x, y, z = camera_points[s, j, 0], camera_points[s, j, 1], camera_points[s, j, 2]
            inverse = camera_points[s, j, 3]
            nx, ny, nz, kappa = tangent_limit(disc, x, y, z)
            unit = 1.0 / math.sqrt(nx * nx + ny * ny + nz * nz)
            nx, ny, nz = unit * nx, unit * ny, unit * nz
            along = (nx * x + ny * y + nz * z) * inverse
            g = unit * kappa - along
            least[group] = min(least[group], g)
            if g < targets[group]:
                f = along * inverse
                gx, gy, gz = inverse * (f * x - nx), inverse * (f * y - ny), inverse * (f * z - nz)
                push_camera_point(systems, costs, s, x, y, z, gx, gy, gz, targets[group] - g)
