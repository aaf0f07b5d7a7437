"""What every constraint leaves along the ways that the camera may really take."""

import math
from typing import NamedTuple

import numpy as np

from omniservo.cameras.unified_kernels import project_point
from omniservo.geometry.arrays import BoolArray, FloatArray
from omniservo.geometry.held import held
from omniservo.geometry.kernel import kernel, leaf
from omniservo.planning.certificate.margin_kinds import CLEARANCE
from omniservo.planning.certificate.seen_margins import centre_margin, smallest_at
from omniservo.planning.constraints.constraints import Constraints
from omniservo.planning.constraints.place import AT, place
from omniservo.risk.servo_response import ServoResponse


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
    ``active`` (W, e + 2) says what is looked at where. ``margins`` is (K, 1, e + 2) for the smallest over all
    places, or (K, W, e + 2) for each; it comes filled with infinity.
    """
    constraints = held(constraints)
    points, camera = drawn
    n, count = points.shape[1], entries.shape[0]
    phi, t, one = np.empty((4, 1)), np.empty((3, 1)), np.ones(1)
    pose, c, turn = np.empty(14), np.empty((n, 4)), np.empty((3, 4))
    for i in range(response.places.shape[0]):
        if not active[i].any():
            continue
        pose[AT] = response.places[i]
        for k in range(points.shape[0]):
            for a in range(4):
                phi[a, 0] = response.quaternions[i, a]
            for a in range(3):
                t[a, 0] = response.translations[i, a]
            place(phi, t, one, one, points[k], pose, c, turn)
            _servo(response, i, camera[k], c, phi, t, pose)
            place(phi, t, one, one, points[k], pose, c, turn)
            _bend(response, i, camera[k], c)
            row = margins[k, min(i, margins.shape[1] - 1)]
            for e in range(count):
                if not active[i, e]:
                    continue
                kind = int(entries[e, 0])
                if kind >= CLEARANCE:
                    row[e] = min(row[e], centre_margin(kind, int(entries[e, 1]), constraints, pose))
                else:
                    row[e] = min(row[e], smallest_at(entries[e], constraints, optics, pose, c, points[k])[0])
            if frame.shape[0] > 0:
                _see_frame(frame, c, row[count:])


@kernel
def _servo(
    response: ServoResponse,
    i: int,
    camera: FloatArray,
    c: FloatArray,
    phi: FloatArray,
    t: FloatArray,
    pose: FloatArray,
) -> None:
    """Move φ (4, 1) and t (3, 1) by −J⁺(s − s_p), s from the camera points c (n, 4)."""
    twist = np.zeros(6)
    inverse = response.inverse[i]
    for j in range(c.shape[0]):
        for a in range(3):
            gap = c[j, a] * c[j, 3] - response.planned[i, j, a]
            for p in range(camera.shape[0]):
                gap += response.lens[i, j, a, p] * camera[p]
            for b in range(6):
                twist[b] -= inverse[b, 3 * j + a] * gap
    for a in range(3):
        t[a, 0] += pose[3 * a] * twist[0] + pose[3 * a + 1] * twist[1] + pose[3 * a + 2] * twist[2]
    x, y, z, w = phi[0, 0], phi[1, 0], phi[2, 0], phi[3, 0]
    a, b, d = 0.5 * twist[3], 0.5 * twist[4], 0.5 * twist[5]
    phi[0, 0] = x + w * a + y * d - z * b
    phi[1, 0] = y + w * b + z * a - x * d
    phi[2, 0] = z + w * d + x * b - y * a
    phi[3, 0] = w - x * a - y * b - z * d


@leaf
def _bend(response: ServoResponse, i: int, camera: FloatArray, c: FloatArray) -> None:
    """Turn camera points c (n, 4) to where the stated camera would see them."""
    if camera.shape[0] == 0:
        return
    for j in range(c.shape[0]):
        distance = 1.0 / c[j, 3]
        for a in range(3):
            for p in range(camera.shape[0]):
                c[j, a] += distance * response.lens[i, j, a, p] * camera[p]


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
