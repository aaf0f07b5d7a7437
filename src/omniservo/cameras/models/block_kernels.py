"""What the models' loops share: point by point, or block by block with arrays of one number each.

In a block, NaN in ``x`` stands for a point that is not valid. `omniservo.geometry.kernel` says what
blocks are for.
"""

import math
from collections.abc import Callable

import numpy as np

from omniservo.cameras.models.plane_kernels import distance_in_domain, plane_point, write_bearing, write_pixel
from omniservo.geometry.arrays import BoolArray, FloatArray
from omniservo.geometry.kernel import BLOCK, inlined, leaf


@inlined
def unproject_each(
    bearing: Callable[[FloatArray, float, float], tuple[float, float, float, bool]],
    p: FloatArray,
    pixels: FloatArray,
    bearings: FloatArray,
    valid: BoolArray,
) -> None:
    """Unproject each row of ``pixels`` (n, 2) into ``bearings`` (n, 3) and ``valid`` (n,).

    ``bearing`` takes ``p`` and a point of the plane in the domain.
    """
    for i in range(pixels.shape[0]):
        mx, my, ok = plane_point(p, pixels[i, 0], pixels[i, 1])
        x, y, z = math.nan, math.nan, math.nan
        if ok:
            x, y, z, ok = bearing(p, mx, my)
        write_bearing(p, x, y, z, ok, i, bearings, valid)


@inlined
def project_blocks(
    to_plane: Callable[[FloatArray, FloatArray, FloatArray, FloatArray], None],
    p: FloatArray,
    points: FloatArray,
    pixels: FloatArray,
    valid: BoolArray,
) -> None:
    """Project each row of ``points`` (n, 3) into ``pixels`` (n, 2) and ``valid`` (n,).

    ``to_plane`` takes ``p`` and a block's x, y, z, and replaces x and y by those of the plane.
    """
    block_x, block_y, block_z = np.empty(BLOCK), np.empty(BLOCK), np.empty(BLOCK)
    for start in range(0, points.shape[0], BLOCK):
        stop = min(start + BLOCK, points.shape[0])
        x, y, z = block_x[: stop - start], block_y[: stop - start], block_z[: stop - start]
        read_points(p, points[start:stop], x, y, z)
        to_plane(p, x, y, z)
        write_pixels(p, x, y, pixels[start:stop], valid[start:stop])


@leaf
def read_points(p: FloatArray, points: FloatArray, x: FloatArray, y: FloatArray, z: FloatArray) -> None:
    """Read points (n, 3); x is NaN where the angle from the axis is not in the domain."""
    for i in range(points.shape[0]):
        x[i], y[i], z[i] = points[i, 0], points[i, 1], points[i, 2]
    for i in range(points.shape[0]):
        _, ok = distance_in_domain(p, x[i], y[i], z[i])
        x[i] = x[i] if ok else math.nan


@leaf
def read_pixels(p: FloatArray, pixels: FloatArray, x: FloatArray, y: FloatArray) -> None:
    """Read pixels (n, 2) as points of the plane; x is NaN outside the domain's disc."""
    for i in range(pixels.shape[0]):
        mx, my, ok = plane_point(p, pixels[i, 0], pixels[i, 1])
        x[i], y[i] = mx if ok else math.nan, my


@leaf
def write_pixels(p: FloatArray, x: FloatArray, y: FloatArray, pixels: FloatArray, valid: BoolArray) -> None:
    """Write the pixels (n, 2) and ``valid`` (n,) of points of the plane."""
    for i in range(pixels.shape[0]):
        write_pixel(p, x[i], y[i], x[i] == x[i], i, pixels, valid)


@leaf
def write_bearings(
    p: FloatArray, x: FloatArray, y: FloatArray, z: FloatArray, bearings: FloatArray, valid: BoolArray
) -> None:
    """Write bearings (n, 3) and ``valid`` (n,)."""
    for i in range(bearings.shape[0]):
        write_bearing(p, x[i], y[i], z[i], x[i] == x[i], i, bearings, valid)
