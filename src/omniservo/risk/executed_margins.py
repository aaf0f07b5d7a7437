"""What every constraint leaves along the ways that the camera may really take."""

import math
from typing import NamedTuple

import numpy as np

from omniservo.cameras.unified_kernels import project_point
from omniservo.geometry.arrays import BoolArray, FloatArray
from omniservo.geometry.held import held
from omniservo.geometry.kernel import kernel, leaf
from omniservo.planning.certificate.margin_kinds import (
    CIRCLE,
    CIRCLE_RADIUS,
    CLEARANCE,
    DOMAIN,
    DOMAIN_ANGLE,
    EDGE,
    ENTRY_INDEX,
    ENTRY_KIND,
    ENTRY_SCALE,
    LEAST,
    MARGIN_PX,
    PX_PER_UNIT,
    XI,
)
from omniservo.planning.certificate.seen_margins import centre_margin, smallest_at
from omniservo.planning.constraints.constraints import Constraints
from omniservo.planning.constraints.place import AT, NORM, TX, TY, TZ
from omniservo.planning.constraints.visibility import OUTSIDE
from omniservo.risk.sample_blocks import LANES, SIDE, block_twists, load_block
from omniservo.risk.servo_response import ServoResponse

_ROTATION = tuple(np.uint64(a) * SIDE for a in range(9))
"""rows of a block of poses (13 rows, as `place` has them): the rotation's,"""

_TX, _TY, _TZ, _NORM = (np.uint64(a) * SIDE for a in (TX, TY, TZ, NORM))
"""the centre's, and ‖φ‖²"""

_NUMBERS = NORM + 1
_TWIST = tuple(np.uint64(a) * SIDE for a in range(6))


class Drawn(NamedTuple):
    """K samples of what an estimate leaves open."""

    points: FloatArray
    """(K, n, 3) [m]"""
    camera: FloatArray
    """(K, p) by what the camera's parameters are off"""


@kernel
def executed_margins(
    constraints: Constraints,
    optics: FloatArray,
    entries: FloatArray,
    frame: FloatArray,
    response: ServoResponse,
    active: BoolArray,
    drawn: Drawn,
    margins: FloatArray,
) -> None:
    """Lower ``margins`` to what every entry leaves to each sample that was drawn, where the servo rests.

    Columns are the entries (e, 4), then border and dead zone of a distorted camera [px], whose
    ``frame`` is (parameters …, width, height, margin, u₀, v₀, radius); (0,) where it is not distorted.
    ``active`` (W, e + 2) says what is checked where. ``margins`` is (K, 1, e + 2) for the smallest over all
    places, or (K, W, e + 2) for each; it comes filled with infinity.
    """
    constraints = held(constraints)
    points, camera = drawn
    samples, n, count = points.shape[0], points.shape[1], entries.shape[0]
    h, lens = np.empty(3 * n * LANES), np.empty(camera.shape[1] * LANES)
    gaps, twist, poses = np.empty(3 * LANES), np.empty(6 * LANES), np.empty(_NUMBERS * LANES)
    c, least, pose, seen = np.empty(4 * n * LANES), np.empty(LANES), np.empty(14), np.empty((n, 4))
    for first in range(0, samples, LANES):
        load_block(points, camera, first, h, lens)
        size = min(LANES, samples - first)
        for i in range(response.places.shape[0]):
            if not active[i].any():
                continue
            block_twists(response, i, h, lens, gaps, twist)
            _moved_poses(
                response.quaternions[i], response.rotations[i], response.translations[i], twist, poses
            )
            for j in range(n):
                _see(h, j, poses, c)
            _bend(response.lens[i], lens, c)
            pose[AT], depth = response.places[i], min(i, margins.shape[1] - 1)
            for e in range(count):
                if not active[i, e]:
                    continue
                kind = int(entries[e, ENTRY_KIND])
                if kind in (EDGE, CIRCLE, DOMAIN, LEAST):
                    _smallest(entries[e], constraints, optics, c, least)
                else:
                    for k in range(size):
                        _pose_of(poses, k, pose)
                        if kind >= CLEARANCE:
                            least[k] = centre_margin(kind, int(entries[e, ENTRY_INDEX]), constraints, pose)
                        else:
                            _seen_by(c, k, seen)
                            there = points[first + k]
                            least[k] = smallest_at(entries[e], constraints, optics, pose, seen, there)[0]
                for k in range(size):
                    margins[first + k, depth, e] = min(margins[first + k, depth, e], least[k])
            if frame.shape[0] > 0:
                for k in range(size):
                    _seen_by(c, k, seen)
                    _see_frame(frame, seen, margins[first + k, depth, count:])


@leaf
def _moved_poses(
    phi: FloatArray, rotation: FloatArray, t: FloatArray, twist: FloatArray, poses: FloatArray
) -> None:
    """Write the poses that twists (6 rows) lead to from the planned one: φ (4,), its rotation, t."""
    x, y, z, w = phi[0], phi[1], phi[2], phi[3]
    xx, xy, xz, yx, yy, yz, zx, zy, zz = _ROTATION
    vx, vy, vz, ox, oy, oz = _TWIST
    for a in range(3):
        row, start = np.uint64(TX + a) * SIDE, t[a]
        by_x, by_y, by_z = rotation[a, 0], rotation[a, 1], rotation[a, 2]
        for k in range(SIDE):
            poses[row + k] = start + by_x * twist[vx + k] + by_y * twist[vy + k] + by_z * twist[vz + k]
    for k in range(SIDE):
        a, b, d = 0.5 * twist[ox + k], 0.5 * twist[oy + k], 0.5 * twist[oz + k]
        p, q = x + w * a + y * d - z * b, y + w * b + z * a - x * d
        r, m = z + w * d + x * b - y * a, w - x * a - y * b - z * d
        poses[_NORM + k] = p * p + q * q + r * r + m * m
        f = 2.0 / max(p * p + q * q + r * r + m * m, 1e-12)
        poses[xx + k], poses[xy + k] = 1.0 - f * (q * q + r * r), f * (p * q - r * m)
        poses[xz + k], poses[yx + k] = f * (p * r + q * m), f * (p * q + r * m)
        poses[yy + k], poses[yz + k] = 1.0 - f * (p * p + r * r), f * (q * r - p * m)
        poses[zx + k], poses[zy + k] = f * (p * r - q * m), f * (q * r + p * m)
        poses[zz + k] = 1.0 - f * (p * p + q * q)


@leaf
def _see(h: FloatArray, j: int, poses: FloatArray, c: FloatArray) -> None:
    """Write point j as each sample's camera sees it."""
    xx, xy, xz, yx, yy, yz, zx, zy, zz = _ROTATION
    x, o = np.uint64(3 * j) * SIDE, np.uint64(4 * j) * SIDE
    y, z = x + SIDE, x + SIDE + SIDE
    o1, o2, o3 = o + SIDE, o + SIDE + SIDE, o + SIDE + SIDE + SIDE
    for k in range(SIDE):
        a, b, d = h[x + k] - poses[_TX + k], h[y + k] - poses[_TY + k], h[z + k] - poses[_TZ + k]
        c[o + k] = poses[xx + k] * a + poses[yx + k] * b + poses[zx + k] * d
        c[o1 + k] = poses[xy + k] * a + poses[yy + k] * b + poses[zy + k] * d
        c[o2 + k] = poses[xz + k] * a + poses[yz + k] * b + poses[zz + k] * d
        c[o3 + k] = 1.0 / max(math.sqrt(a * a + b * b + d * d), 1e-12)


@leaf
def _bend(slopes: FloatArray, lens: FloatArray, c: FloatArray) -> None:
    """Turn what is seen to where the stated camera would see it, slopes (n, 3, p)."""
    for j in range(slopes.shape[0]):
        o3 = np.uint64(4 * j + 3) * SIDE
        for a in range(3):
            o = np.uint64(4 * j + a) * SIDE
            for p in range(slopes.shape[2]):
                slope, parameter = slopes[j, a, p], np.uint64(p) * SIDE
                for k in range(SIDE):
                    c[o + k] += slope * lens[parameter + k] / c[o3 + k]


@kernel
def _smallest(
    entry: FloatArray, constraints: Constraints, optics: FloatArray, c: FloatArray, least: FloatArray
) -> None:
    """Write what an EDGE, CIRCLE, DOMAIN or LEAST entry leaves: as `camera_margin`, without branches.

    The largest angle is that of the smallest cosine.
    """
    kind, n = int(entry[ENTRY_KIND]), c.shape[0] // (4 * LANES)
    least[:] = math.inf
    for j in range(n):
        if kind == EDGE:
            _lower_to_edge(
                constraints.limits[int(entry[ENTRY_INDEX])],
                float(entry[ENTRY_SCALE]),
                optics[XI],
                c,
                j,
                least,
            )
        elif kind == CIRCLE:
            _lower_to_circle(optics, c, j, least)
        elif kind == LEAST:
            _lower_to_distance(constraints.least_distance, c, j, least)
        else:
            _lower_to_cosine(c, j, least)
    if kind == DOMAIN:
        for k in range(LANES):
            cosine = least[k]
            least[k] = optics[DOMAIN_ANGLE] - math.atan2(math.sqrt(max(1.0 - cosine * cosine, 0.0)), cosine)


@leaf
def _lower_to_edge(
    limit: FloatArray, scale: float, xi: float, c: FloatArray, j: int, least: FloatArray
) -> None:
    """Lower ``least`` to what an edge leaves to point j."""
    o = np.uint64(4 * j) * SIDE
    o1, o2, o3 = o + SIDE, o + SIDE + SIDE, o + SIDE + SIDE + SIDE
    nx, ny, nz, bound = limit[0], limit[1], limit[2], limit[3]
    for k in range(SIDE):
        x, y, z, rho = c[o + k], c[o1 + k], c[o2 + k], 1.0 / c[o3 + k]
        d = z + xi * rho
        value = (bound * rho - nx * x - ny * y - nz * z) / d * scale
        value = value if d > 0.0 else OUTSIDE
        least[k] = value if value < least[k] else least[k]


@leaf
def _lower_to_circle(optics: FloatArray, c: FloatArray, j: int, least: FloatArray) -> None:
    """Lower ``least`` to what the circle leaves to point j."""
    o = np.uint64(4 * j) * SIDE
    o1, o2, o3 = o + SIDE, o + SIDE + SIDE, o + SIDE + SIDE + SIDE
    xi, radius, size, margin = optics[XI], optics[CIRCLE_RADIUS], optics[PX_PER_UNIT], optics[MARGIN_PX]
    for k in range(SIDE):
        x, y, z, rho = c[o + k], c[o1 + k], c[o2 + k], 1.0 / c[o3 + k]
        d = z + xi * rho
        value = (radius - math.sqrt(x * x + y * y) / d) * size - margin
        value = value if d > 0.0 else OUTSIDE
        least[k] = value if value < least[k] else least[k]


@leaf
def _lower_to_distance(asked: float, c: FloatArray, j: int, least: FloatArray) -> None:
    """Lower ``least`` to what the distance of point j is more than is required."""
    o3 = np.uint64(4 * j + 3) * SIDE
    for k in range(SIDE):
        value = 1.0 / c[o3 + k] - asked
        least[k] = value if value < least[k] else least[k]


@leaf
def _lower_to_cosine(c: FloatArray, j: int, least: FloatArray) -> None:
    """Lower ``least`` to the cosine of point j's angle to the optical axis."""
    o = np.uint64(4 * j) * SIDE
    o1, o2 = o + SIDE, o + SIDE + SIDE
    for k in range(SIDE):
        x, y, z = c[o + k], c[o1 + k], c[o2 + k]
        value = z / math.sqrt(x * x + y * y + z * z)
        least[k] = value if value < least[k] else least[k]


@leaf
def _pose_of(poses: FloatArray, k: int, pose: FloatArray) -> None:
    """Write one sample's pose (14,), but for its w."""
    for a in range(_NUMBERS):
        pose[a] = poses[a * LANES + k]


@leaf
def _seen_by(c: FloatArray, k: int, seen: FloatArray) -> None:
    """Write one sample's camera points (n, 4)."""
    for j in range(seen.shape[0]):
        for a in range(4):
            seen[j, a] = c[(4 * j + a) * LANES + k]


@leaf
def _see_frame(frame: FloatArray, c: FloatArray, row: FloatArray) -> None:
    """Lower row (2,) to what the border and the dead zone of a distorted image leave to c (n, 4) [px]."""
    tail = frame[frame.shape[0] - 6 :]
    for j in range(c.shape[0]):
        u, v, ok = project_point(frame[: frame.shape[0] - 6], c[j, 0], c[j, 1], c[j, 2])
        if not ok:
            row[0] = -1e6
            continue
        border = min(u + 0.5, tail[0] - 0.5 - u, v + 0.5, tail[1] - 0.5 - v)
        row[0] = min(row[0], border - tail[2])
        if tail[5] > 0.0:
            row[1] = min(row[1], math.hypot(u - tail[3], v - tail[4]) - tail[5] - tail[2])
