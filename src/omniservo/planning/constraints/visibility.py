"""Visibility: every image limit is a cone n·c ≤ κ‖c‖ about a fixed axis (method: image limits are cones).

Proof on a piece of the path with control points C₀ … C_d of c(w), d = 2σ + τ:

- κ < 0: the limit is a convex cone; the piece lies inside when every control point does.
- κ ≥ 0: the limit is the outside of a convex cap. ‖c‖ ≥ e·c for every ‖e‖ ≤ 1, so (n − κe)·Cₖ ≤ 0 for all k
  suffices; e is the mean bearing of the piece, or that of the control point with the least left.

Either way the bound gets exact quadratically as pieces are halved, so the proof ends for every path that
keeps the limit strictly.
"""

import math
from typing import NamedTuple

import numpy as np

from omniservo.geometry.arrays import FloatArray
from omniservo.geometry.kernel import kernel, late, leaf
from omniservo.geometry.polynomial import TINY
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
    Pieces,
    first_piece,
    subdivide,
)
from omniservo.geometry.vectors import copy_into
from omniservo.planning.constraints.constraints import Constraints
from omniservo.planning.constraints.dead_zone import Limit, disc_size, tangent_limit
from omniservo.planning.constraints.push import ASLEEP, Samples, push_camera_point

TEST_COUNT = 14
"""Roundings of one test of a control point against a limit, those of n, κ and e included."""

OUTSIDE = -1e6
"""What an image limit leaves to a point outside the model's domain [px]."""


class _Limits(NamedTuple):
    """What a point is to keep in the image."""

    cones: FloatArray
    """(k, 4)"""
    disc: FloatArray
    """The dead zone, (7,) or (0,)."""
    sizes: FloatArray
    """The magnitude of each limit and of the dead zone (k+1,), for error bounds."""


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
    pieces = first_piece(controls[0], np.empty((3, 0)), 1)
    for j in range(controls.shape[0]):
        copy_into(controls[j], pieces.curve[0])
        bounds = Bounds(count + TEST_COUNT, float(degree), errors[j], MAX_LEVEL, MAX_PIECES)
        status, w, i = _prove_point(pieces, bounds, _Limits(limits, disc, sizes))
        if status != PROVEN:
            return status, w, j, i
    return PROVEN, 0.0, 0, 0


@leaf
def _prove_point(pieces: Pieces, bounds: Bounds, limits: _Limits) -> tuple[int, float, int]:
    """Decide every limit for one point: status, w, limit."""
    return subdivide(_in_image, limits, pieces, bounds)


@kernel
def _in_image(piece: Piece, limits: _Limits) -> tuple[int, int]:
    """Show every limit on a piece, from the first on that is left; what fails or is open is that limit."""
    curve, cones, disc = piece.curve, limits.cones, limits.disc
    mx, my, mz = sum_of_controls(curve)
    norm = math.sqrt(mx * mx + my * my + mz * mz)
    shorter = (1.0 - 1e-15) / norm if norm > 0.0 else 0.0
    ex, ey, ez = mx * shorter, my * shorter, mz * shorter
    rows = cones.shape[0]
    for i in range(piece.left[0], rows):
        allowed = piece.bound * float(limits.sizes[i]) + TINY
        limit = (cones[i, 0], cones[i, 1], cones[i, 2], cones[i, 3])
        if cone_holds(curve, limit, ex, ey, ez, allowed) or holds_by_tightest(curve, limit, allowed):
            continue
        piece.left[0] = i
        return _violated_end(curve, limit, limit, allowed), i
    if disc.shape[0] > 0:
        allowed = piece.bound * float(limits.sizes[rows]) + TINY
        if not cone_holds(curve, tangent_limit(disc, mx, my, mz), ex, ey, ez, allowed):
            piece.left[0] = rows
            last = curve.shape[1] - 1
            at_start = tangent_limit(disc, curve[0, 0], curve[1, 0], curve[2, 0])
            at_end = tangent_limit(disc, curve[0, last], curve[1, last], curve[2, last])
            return _violated_end(curve, at_start, at_end, allowed), rows
    return HOLDS, 0


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
def _violated_end(curve: FloatArray, at_start: Limit, at_end: Limit, bound: float) -> int:
    """Tell at which end n·c > κ‖c‖ beyond rounding, each with the limit that holds there, or OPEN."""
    if cone_value(curve, at_start, 0) > bound:
        return FAILS_AT_START
    return FAILS_AT_END if cone_value(curve, at_end, curve.shape[1] - 1) > bound else OPEN


@leaf
def cone_value(piece: FloatArray, limit: Limit, k: int) -> float:
    """Return n·C − κ‖C‖ of control point k."""
    nx, ny, nz, kappa = limit
    x, y, z = float(piece[0, k]), float(piece[1, k]), float(piece[2, k])
    return nx * x + ny * y + nz * z - kappa * math.sqrt(x * x + y * y + z * z)


@leaf
def push_into_image(limits: FloatArray, samples: Samples, first: int) -> None:
    """Push every point inside limits (k, 4), n of unit length (see `push`).

    g = κ − n·b, b = c/‖c‖, ∂g/∂c = −(n − (n·b) b)/‖c‖.
    """
    camera_points, targets, least = samples.camera_points, samples.targets, samples.least
    systems, costs = samples.systems, samples.costs
    for i in range(limits.shape[0]):
        group = first + i
        if targets[group] == ASLEEP:
            continue
        nx, ny, nz, kappa = limits[i, 0], limits[i, 1], limits[i, 2], limits[i, 3]
        target, lowest = targets[group], least[group]
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
                    push_camera_point(systems, costs, s, (x, y, z), (gx, gy, gz), target - g)
        least[group] = lowest


@late
def push_off_disc(constraints: Constraints, samples: Samples) -> None:
    """Push every point off the dead zone, by the tangent that faces it, its normal of length 1."""
    disc, group = constraints.disc, constraints.slots.dead_zone
    camera_points, targets, least = samples.camera_points, samples.targets, samples.least
    systems, costs = samples.systems, samples.costs
    if targets[group] == ASLEEP:
        return
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
                push_camera_point(systems, costs, s, (x, y, z), (gx, gy, gz), targets[group] - g)
