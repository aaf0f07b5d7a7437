"""The visibility filter's quadratic program, compiled: the nearest twist that keeps every point in view."""

import math
from typing import NamedTuple

import numpy as np

from omniservo.cameras.unified_kernels import XI, project_point_jacobian, unproject_pixel
from omniservo.geometry.arrays import BoolArray, FloatArray, IntArray
from omniservo.geometry.kernel import kernel, leaf
from omniservo.geometry.quadratic_program import quadratic_step
from omniservo.servoing.control_law import limit_twist

RATE, DELAY, MAX_LINEAR, MAX_ANGULAR = range(4)
"""Places in ``settings``."""

LOW_U, HIGH_U, LOW_V, HIGH_V, RADIUS, SCALE, ZONE_U, ZONE_V, ZONE_RADIUS = range(9)
"""Places in `Limits.image` [px], all moved inward by the margin; RADIUS on the normalised plane, SCALE in px
per unit of it; ZONE_RADIUS is negative where there is no dead zone."""

LEAST, SLACK, ACTIVE, SOLVED = range(4)
"""Places in ``evidence``: the least height of a point above its limits [px], what the worst row lacks [px/s],
how many rows hold the twist back, and whether the program was solved (1 or 0)."""

SLACK_WEIGHT = 1e-2
"""cost of a slack of 1 px/s, squared, beside that of 1 rad/s"""

ENOUGH, ENOUGH_OF = 1e-7, 1e-7
"""A row holds that lacks less [px/s], or less than this part of what the wanted twist lacks most: of a fast
twist before near points no more can be had, by rounding"""

MOST_ROUNDS = 60
MOST_ROWS = 24
"""of the working set: six hold a twist, and a few more are in doubt"""


class Limits(NamedTuple):
    """What bounds the image."""

    image: FloatArray
    """(9,) see LOW_U and the rest"""
    edges: FloatArray
    """(k, 3) lines n, b of the mask's polygons [px]; outside one where n·p ≥ b"""
    ends: IntArray
    """(polygons,) where the rows of each polygon end"""


class KeptPoints(NamedTuple):
    """The points that are kept in view."""

    points: FloatArray
    """(n, 3) in the camera frame at the exposure [m]; one at the origin does not count"""
    pixels: FloatArray
    """(n, 2) where they were seen [px]"""
    valid: BoolArray
    """(n,) which of them were: those are taken in the pixel's direction"""


@kernel
def keep_in_view(
    parameters: FloatArray,
    limits: tuple[FloatArray, FloatArray, IntArray],
    settings: FloatArray,
    seen: tuple[FloatArray, FloatArray, BoolArray],
    last: FloatArray,
    wanted: FloatArray,
    twist: FloatArray,
    evidence: FloatArray,
) -> None:
    """Write the twist (6,) nearest to ``wanted`` with ḣ ≥ −κ h for every point and limit.

    Nearest: least ‖v/d − v*/d‖² + ‖ω − ω*‖², d the points' mean distance. A row of a point that is beyond a
    limit (h < 0) may be missed, at a price; all others hold, as the zero twist does. The result is scaled as
    a whole to the speed limits, by which a row with h ≥ 0 does not cease to hold.

    Args:
        parameters: the camera's.
        limits: the fields of `Limits`; a plain tuple, since to read a named one's type takes Numba longer.
        settings: (4,), see RATE and the rest.
        seen: the fields of `KeptPoints`, likewise.
        last: (6,) the twist that acts until the new one does.
        wanted: (6,) finite.
        twist: (6,) out.
        evidence: (4,) out, see LEAST and the rest.
    """
    bounds, target = Limits(*limits), KeptPoints(*seen)
    most = target.points.shape[0] * (6 + len(bounds.ends))
    rows, right, heights = np.empty((most, 6)), np.empty(most), np.empty(most)
    count, distance = _write_rows(parameters, bounds, target, settings[DELAY], last, rows, heights)
    evidence[:] = 0.0
    evidence[LEAST] = math.inf
    for i in range(count):
        right[i] = -settings[RATE] * heights[i]
        evidence[LEAST] = min(evidence[LEAST], heights[i])
    for a in range(6):
        twist[a] = wanted[a]
    limit_twist(twist, settings[MAX_LINEAR], settings[MAX_ANGULAR])
    solved = True
    if count > 0:
        solved = _nearest(rows[:count], right[:count], heights[:count], distance, twist, evidence)
    finite = 0.0
    for a in range(6):
        finite += abs(twist[a])
    if not (solved and finite < math.inf):
        twist[:] = 0.0
        solved = False
    limit_twist(twist, settings[MAX_LINEAR], settings[MAX_ANGULAR])
    for i in range(count):
        evidence[SLACK] = max(evidence[SLACK], right[i] - _times(rows, i, twist))
    evidence[SOLVED] = 1.0 if solved else 0.0


@leaf
def _write_rows(
    parameters: FloatArray,
    limits: Limits,
    seen: KeptPoints,
    delay: float,
    last: FloatArray,
    rows: FloatArray,
    heights: FloatArray,
) -> tuple[int, float]:
    """Write the rows of all points and limits; return how many, and the points' mean distance [m]."""
    points, pixels, valid = seen
    count, total, projected = 0, 0.0, 0
    for j in range(points.shape[0]):
        x, y, z = points[j, 0], points[j, 1], points[j, 2]
        distance = math.sqrt(x * x + y * y + z * z)
        if valid[j]:
            a, b, c, ok = unproject_pixel(parameters, pixels[j, 0], pixels[j, 1])
            if ok:
                x, y, z = distance * a, distance * b, distance * c
        x, y, z = _carried(x, y, z, last, delay)
        count, ok = _write_limits(parameters, limits, x, y, z, rows, heights, count)
        if ok:
            total += distance
            projected += 1
    return count, total / projected if projected > 0 else 1.0


@leaf
def _carried(x: float, y: float, z: float, twist: FloatArray, time: float) -> tuple[float, float, float]:
    """Return where a point that stands still is seen after ``time`` [s] of a twist: c − (v + ω × c) t."""
    return (
        x - time * (twist[0] + twist[4] * z - twist[5] * y),
        y - time * (twist[1] + twist[5] * x - twist[3] * z),
        z - time * (twist[2] + twist[3] * y - twist[4] * x),
    )


@kernel
def _write_limits(
    parameters: FloatArray,
    limits: Limits,
    x: float,
    y: float,
    z: float,
    rows: FloatArray,
    heights: FloatArray,
    count: int,
) -> tuple[int, bool]:
    """Append the rows ∂ḣ/∂(v, ω) and heights h [px] of one point; False without a projection.

    What is too far beyond the lens's circle to have a projection has the row of that circle alone.
    """
    image, edges, ends = limits
    u, v, ux, uy, uz, vx, vy, vz, ok = project_point_jacobian(parameters, x, y, z)
    if not ok:
        if image[RADIUS] < math.inf and _has_radius(parameters[XI], x, y, z):
            count = _append_rim(parameters[XI], image, x, y, z, rows, heights, count)
        return count, False
    du, dv = np.empty(6), np.empty(6)
    _write_flow(ux, uy, uz, x, y, z, du)
    _write_flow(vx, vy, vz, x, y, z, dv)
    count = _append(u - image[LOW_U], 1.0, 0.0, du, dv, rows, heights, count)
    count = _append(image[HIGH_U] - u, -1.0, 0.0, du, dv, rows, heights, count)
    count = _append(v - image[LOW_V], 0.0, 1.0, du, dv, rows, heights, count)
    count = _append(image[HIGH_V] - v, 0.0, -1.0, du, dv, rows, heights, count)
    if image[RADIUS] < math.inf:
        count = _append_rim(parameters[XI], image, x, y, z, rows, heights, count)
    if image[ZONE_RADIUS] >= 0.0:
        along, across = u - image[ZONE_U], v - image[ZONE_V]
        far = max(math.hypot(along, across), 1e-9)
        height = far - image[ZONE_RADIUS]
        count = _append(height, along / far, across / far, du, dv, rows, heights, count)
    first = 0
    for p in range(ends.shape[0]):
        best, most = first, -math.inf
        for k in range(first, ends[p]):
            height = edges[k, 0] * u + edges[k, 1] * v - edges[k, 2]
            if height > most:
                best, most = k, height
        count = _append(most, edges[best, 0], edges[best, 1], du, dv, rows, heights, count)
        first = ends[p]
    return count, True


@leaf
def _write_flow(gx: float, gy: float, gz: float, x: float, y: float, z: float, flow: FloatArray) -> None:
    """Write g·ċ as a row of the twist, with ċ = −v − ω × c: (−g, −c × g)."""
    flow[0], flow[1], flow[2] = -gx, -gy, -gz
    flow[3] = z * gy - y * gz
    flow[4] = x * gz - z * gx
    flow[5] = y * gx - x * gy


@leaf
def _append(
    height: float,
    a: float,
    b: float,
    du: FloatArray,
    dv: FloatArray,
    rows: FloatArray,
    heights: FloatArray,
    count: int,
) -> int:
    heights[count] = height
    for k in range(6):
        rows[count, k] = a * du[k] + b * dv[k]
    return count + 1


@leaf
def _has_radius(xi: float, x: float, y: float, z: float) -> bool:
    """Whether √(X² + Y²)/(Z + ξρ) exists and grows outwards: Z > −ξρ, for ξ > 1 Z > −ρ/ξ."""
    rho = math.sqrt(x * x + y * y + z * z)
    return z > -rho * (xi if xi <= 1.0 else 1.0 / xi)


@leaf
def _append_rim(
    xi: float,
    image: FloatArray,
    x: float,
    y: float,
    z: float,
    rows: FloatArray,
    heights: FloatArray,
    count: int,
) -> int:
    """Append the limit of the lens, (R − r)·SCALE with r = √(X² + Y²)/(Z + ξρ) on the normalised plane."""
    across, rho = math.sqrt(x * x + y * y), math.sqrt(x * x + y * y + z * z)
    if not across > 1e-12 * rho:
        return count
    below = z + xi * rho
    r, scale = across / below, -image[SCALE] / below
    heights[count] = (image[RADIUS] - r) * image[SCALE]
    gx = scale * (x / across - r * xi * x / rho)
    gy = scale * (y / across - r * xi * y / rho)
    gz = -scale * r * (1.0 + xi * z / rho)
    _write_flow(gx, gy, gz, x, y, z, rows[count])
    return count + 1


@leaf
def _times(rows: FloatArray, i: int, twist: FloatArray) -> float:
    total = 0.0
    for a in range(6):
        total += rows[i, a] * twist[a]
    return total


@kernel
def _nearest(
    rows: FloatArray,
    right: FloatArray,
    heights: FloatArray,
    distance: float,
    twist: FloatArray,
    evidence: FloatArray,
) -> bool:
    """Replace the twist by the nearest that keeps the rows; False where that was not found.

    The row that lacks most joins the working set, the program is solved on it, rows that do not hold the
    twist leave it, until none lacks anything. The program's least value grows with every round, so none
    comes back. The seventh variable is the slack that the rows of points beyond a limit share.
    """
    hessian, gradient = np.eye(7), np.zeros(7)
    hessian[6, 6] = SLACK_WEIGHT
    for a in range(6):
        gradient[a] = -twist[a] / (distance if a < 3 else 1.0)
    working, bounds = np.empty((MOST_ROWS, 7)), np.empty(MOST_ROWS)
    step, multipliers = np.zeros(7), np.zeros(MOST_ROWS)
    size, enough = 0, ENOUGH
    for i in range(rows.shape[0]):
        enough = max(enough, ENOUGH_OF * (right[i] - _times(rows, i, twist)))
    for _ in range(MOST_ROUNDS):
        worst, most = -1, enough
        for i in range(rows.shape[0]):
            lacks = right[i] - _times(rows, i, twist) - (step[6] if heights[i] < 0.0 else 0.0)
            if lacks > most:
                worst, most = i, lacks
        if worst < 0:
            evidence[ACTIVE] = size
            return True
        if size == MOST_ROWS:
            return False
        length = 0.0
        for a in range(6):
            working[size, a] = rows[worst, a] * (distance if a < 3 else 1.0)
            length += working[size, a] ** 2
        length = max(math.sqrt(length), 1e-300)
        working[size, 6] = 1.0 if heights[worst] < 0.0 else 0.0
        for a in range(7):  # of length 1: the program misses rows by a share of the longest
            working[size, a] /= length
        bounds[size] = right[worst] / length
        size += 1
        if not quadratic_step(hessian, gradient, working[:size], bounds[:size], step, multipliers[:size]):
            return False
        kept = 0
        for i in range(size):
            if multipliers[i] > 0.0:
                working[kept], bounds[kept] = working[i], bounds[i]
                kept += 1
        size = kept
        for a in range(6):
            twist[a] = step[a] * (distance if a < 3 else 1.0)
    return False
