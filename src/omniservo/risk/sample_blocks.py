"""Samples side by side: `SIDE` of them at once, so that loops over them become vector instructions.

A block is a flat array of rows, `SIDE` numbers each: coordinate a of point j is row 3j + a of a structure
(3n rows), row 4j + a of what the camera sees (4n rows: x, y, z, 1/distance). A block that is not full has its
last sample several times. Indices are unsigned: a signed one could count from the end, which takes a branch.
"""

import math

import numpy as np

from omniservo.geometry.arrays import FloatArray
from omniservo.geometry.kernel import kernel, leaf
from omniservo.risk.servo_response import ServoResponse

LANES = 64
"""samples in a block: twenty points of them stay in the nearest cache"""

SIDE = np.uint64(LANES)
_TWICE = np.uint64(2 * LANES)


@leaf
def load_block(points: FloatArray, camera: FloatArray, first: int, h: FloatArray, lens: FloatArray) -> None:
    """Write structures h and deviations ``lens`` (p rows) of points (K, n, 3), camera (K, p) from one on."""
    last = points.shape[0] - 1
    for k in range(LANES):
        sample = min(first + k, last)
        for j in range(points.shape[1]):
            for a in range(3):
                h[(3 * j + a) * LANES + k] = points[sample, j, a]
        for p in range(camera.shape[1]):
            lens[p * LANES + k] = camera[sample, p]


@kernel
def block_twists(
    response: ServoResponse, i: int, h: FloatArray, lens: FloatArray, gaps: FloatArray, twist: FloatArray
) -> None:
    """Write −J⁺(s − s_p) at place i (6 rows); ``gaps`` (3 rows) is room for s − s_p of one point."""
    twist[:] = 0.0
    for j in range(response.planned.shape[1]):
        _point_gaps(h, j, response.rotations[i], response.translations[i], response.planned[i, j], gaps)
        _add_lens(response.lens[i, j], lens, gaps)
        _add_twists(response.inverse[i], j, gaps, twist)


@leaf
def _point_gaps(
    h: FloatArray, j: int, rotation: FloatArray, t: FloatArray, planned: FloatArray, gaps: FloatArray
) -> None:
    """Write s − s_p of point j, seen from the planned pose."""
    tx, ty, tz = t[0], t[1], t[2]
    xx, xy, xz = rotation[0, 0], rotation[0, 1], rotation[0, 2]
    yx, yy, yz = rotation[1, 0], rotation[1, 1], rotation[1, 2]
    zx, zy, zz = rotation[2, 0], rotation[2, 1], rotation[2, 2]
    px, py, pz = planned[0], planned[1], planned[2]
    x = np.uint64(3 * j) * SIDE
    y, z = x + SIDE, x + _TWICE
    for k in range(SIDE):
        a, b, c = h[x + k] - tx, h[y + k] - ty, h[z + k] - tz
        nearness = 1.0 / max(math.sqrt(a * a + b * b + c * c), 1e-12)
        gaps[k] = (xx * a + yx * b + zx * c) * nearness - px
        gaps[SIDE + k] = (xy * a + yy * b + zy * c) * nearness - py
        gaps[_TWICE + k] = (xz * a + yz * b + zz * c) * nearness - pz


@leaf
def _add_lens(slopes: FloatArray, lens: FloatArray, gaps: FloatArray) -> None:
    """Add ∂s/∂θ dθ, slopes (3, p), to the gaps of one point."""
    for p in range(slopes.shape[1]):
        parameter = np.uint64(p) * SIDE
        for a in range(3):
            slope, row = slopes[a, p], np.uint64(a) * SIDE
            for k in range(SIDE):
                gaps[row + k] += slope * lens[parameter + k]


@leaf
def _add_twists(inverse: FloatArray, j: int, gaps: FloatArray, twist: FloatArray) -> None:
    """Add what the gaps of point j move the camera by, inverse (6, 3n)."""
    for b in range(6):
        x, y, z = inverse[b, 3 * j], inverse[b, 3 * j + 1], inverse[b, 3 * j + 2]
        row = np.uint64(b) * SIDE
        for k in range(SIDE):
            twist[row + k] = twist[row + k] - x * gaps[k] - y * gaps[SIDE + k] - z * gaps[_TWICE + k]


@kernel
def resting_twists(
    response: ServoResponse, points: FloatArray, camera: FloatArray, twists: FloatArray
) -> None:
    """Write by how much the servo rests beside each place for each sample (W, K, 6), in the camera frame."""
    samples, n = points.shape[0], points.shape[1]
    h, lens = np.empty(3 * n * LANES), np.empty(camera.shape[1] * LANES)
    gaps, twist = np.empty(3 * LANES), np.empty(6 * LANES)
    for first in range(0, samples, LANES):
        load_block(points, camera, first, h, lens)
        for i in range(response.places.shape[0]):
            block_twists(response, i, h, lens, gaps, twist)
            for k in range(min(LANES, samples - first)):
                for b in range(6):
                    twists[i, first + k, b] = twist[b * LANES + k]
