"""The loops over the samples of many patches."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from omniservo.geometry.arrays import FloatArray, IntArray
from omniservo.geometry.kernel import kernel, leaf

FloatImage = npt.NDArray[np.float32]

LEAST_GAIN = 0.1
"""a patch that is less alike is not pulled at all harder"""


@leaf
def write_rays(
    bearings: FloatArray,
    first: FloatArray,
    places: FloatArray,
    maps: FloatArray,
    samples: FloatArray,
    rays: FloatArray,
) -> None:
    """Write the directions of samples u of patches: b + x·e + y·(b × e) with (x, y) = p + M·u.

    Args:
        bearings: (n, 3) b.
        first: (n, 3) e.
        places: (n, 2) p.
        maps: (n, 2, 2) M.
        samples: (k, 2) u.
        rays: (n, k, 3) written; not unit.
    """
    for i in range(len(bearings)):
        bx, by, bz = bearings[i]
        ex, ey, ez = first[i]
        fx, fy, fz = by * ez - bz * ey, bz * ex - bx * ez, bx * ey - by * ex
        for s in range(len(samples)):
            u, v = samples[s]
            x = places[i, 0] + maps[i, 0, 0] * u + maps[i, 0, 1] * v
            y = places[i, 1] + maps[i, 1, 0] * u + maps[i, 1, 1] * v
            rays[i, s, 0] = bx + x * ex + y * fx
            rays[i, s, 1] = by + x * ey + y * fy
            rays[i, s, 2] = bz + x * ez + y * fz


@kernel
def write_greys(image: FloatImage, pixels: FloatArray, greys: FloatArray) -> None:
    """Interpolate with Keys' cubic (a = −½); outside the image, its border goes on.

    ``cv2.remap`` would round every place to 1/32 px, about the accuracy that is wanted of the whole patch.

    Args:
        image: (height, width).
        pixels: (n, k, 2) [px]; the grey at NaN is 0.
        greys: (n, k) written.
    """
    height, width = image.shape
    for i in range(pixels.shape[0]):
        for s in range(pixels.shape[1]):
            u, v = pixels[i, s]
            greys[i, s] = 0.0
            if not (abs(u) < 1e9 and abs(v) < 1e9):
                continue
            column, row = int(np.floor(u)), int(np.floor(v))
            x, y = u - column, v - row
            for b in range(4):
                r = min(max(row - 1 + b, 0), height - 1)
                line = 0.0
                for a in range(4):
                    c = min(max(column - 1 + a, 0), width - 1)
                    line += _cubic(a, x) * image[r, c]
                greys[i, s] += _cubic(b, y) * line


@leaf
def _cubic(tap: int, x: float) -> float:
    """Weight of the neighbour ``tap`` (0…3) at −1, 0, 1, 2 for a place x in [0, 1)."""
    if tap == 0:
        return ((-0.5 * x + 1.0) * x - 0.5) * x
    if tap == 1:
        return (1.5 * x - 2.5) * x * x + 1.0
    if tap == 2:
        return ((-1.5 * x + 2.0) * x + 0.5) * x
    return (0.5 * x - 0.5) * x * x


@kernel
def normalise(values: FloatArray, weight: FloatArray, norm: FloatArray) -> None:
    """Bring each row of ``values`` (n, k) to weighted mean 0 and weighted norm 1; a flat one to 0.

    Args:
        values: (n, k) changed.
        weight: (k,) of sum 1.
        norm: (n,) written: the weighted norm before.
    """
    n, k = values.shape
    for i in range(n):
        mean = 0.0
        for s in range(k):
            mean += weight[s] * values[i, s]
        square = 0.0
        for s in range(k):
            values[i, s] -= mean
            square += weight[s] * values[i, s] ** 2
        norm[i] = np.sqrt(square)
        factor = 1.0 / norm[i] if norm[i] > 0.0 else 0.0
        for s in range(k):
            values[i, s] *= factor


@leaf
def write_pulls(
    rows: IntArray, values: FloatArray, weight: FloatArray, grey: FloatArray, steepest: FloatArray,
    correlation: FloatArray, scatter: FloatArray, pulls: FloatArray,
) -> None:  # fmt: skip
    """Compare patches with their templates.

    Args:
        rows: (m,) which templates.
        values: (m, k) normalised grey values of the patches.
        weight: (k,) of sum 1.
        grey: (n, k) normalised grey values of the templates.
        steepest: (n, k, 6) their derivatives.
        correlation: (m,) written, weighted.
        scatter: (m,) written, the weighted mean square of the difference.
        pulls: (m, 6) written, the weighted sum of derivative times difference.
    """
    k = len(weight)
    for i in range(len(rows)):
        row = rows[i]
        alike = 0.0
        for s in range(k):
            alike += weight[s] * values[i, s] * grey[row, s]
        correlation[i] = alike
        gain = max(alike, LEAST_GAIN)
        scatter[i] = 0.0
        pulls[i] = 0.0
        for s in range(k):
            difference = gain * values[i, s] - grey[row, s]
            scatter[i] += weight[s] * difference * difference
            for p in range(6):
                pulls[i, p] += weight[s] * steepest[row, s, p] * difference


@leaf
def write_templates(
    square: FloatArray, samples: FloatArray, weight: FloatArray, grey: FloatArray, norm: FloatArray,
    steepest: FloatArray, normal: FloatArray,
) -> None:  # fmt: skip
    """Prepare templates from patches with a rim of one sample.

    Args:
        square: (n, side + 2, side + 2) grey values.
        samples: (side², 2) u, row by row.
        weight: (side²,) of sum 1.
        grey: (n, side²) the normalised grey values.
        norm: (n,) of the patches without rim.
        steepest: (n, side², 6) written: derivative of ``grey`` by the map's (a, b, c, d, x, y), less its
            parts along 1 and along ``grey``, which offset and gain absorb.
        normal: (n, 6, 6) written: weighted sum of its products.
    """
    k, side = len(weight), square.shape[1] - 2
    for i in range(len(square)):
        scale = 0.5 / norm[i] if norm[i] > 0.0 else 0.0
        for s in range(k):
            row, column = s // side + 1, s % side + 1
            dx = scale * (square[i, row, column + 1] - square[i, row, column - 1])
            dy = scale * (square[i, row + 1, column] - square[i, row - 1, column])
            steepest[i, s, 0], steepest[i, s, 1] = dx * samples[s, 0], dx * samples[s, 1]
            steepest[i, s, 2], steepest[i, s, 3] = dy * samples[s, 0], dy * samples[s, 1]
            steepest[i, s, 4], steepest[i, s, 5] = dx, dy
        for p in range(6):
            mean, along = 0.0, 0.0
            for s in range(k):
                mean += weight[s] * steepest[i, s, p]
                along += weight[s] * steepest[i, s, p] * grey[i, s]
            for s in range(k):
                steepest[i, s, p] -= mean + along * grey[i, s]
        normal[i] = 0.0
        for s in range(k):
            for p in range(6):
                for q in range(p, 6):
                    normal[i, p, q] += weight[s] * steepest[i, s, p] * steepest[i, s, q]
        for p in range(6):
            for q in range(p):
                normal[i, p, q] = normal[i, q, p]
