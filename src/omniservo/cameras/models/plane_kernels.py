"""What all models' loops share: the domain's tests, and the affine map between the plane and pixels.

Conditions are joined by ``&``, which is no branch: a branch in these loops makes them three times slower.
"""

import math

from omniservo.geometry.arrays import BoolArray, FloatArray
from omniservo.geometry.kernel import inlined

_LEAST_SQUARE = 1e-280
_LARGEST_SQUARE = 1e280
_INWARDS = 6e-14
"""on ‖m‖²: what is unprojected lies so far inside the largest that is projected"""


@inlined
def distance_in_domain(p: FloatArray, x: float, y: float, z: float) -> tuple[float, bool]:
    """Return ρ = ‖(x, y, z)‖, and whether the point's angle from the axis is in the domain."""
    square = x * x + y * y + z * z
    rho = math.sqrt(square)
    return rho, (square > _LEAST_SQUARE) & (square < _LARGEST_SQUARE) & (z > p[10] * rho)


@inlined
def write_pixel(
    p: FloatArray, mx: float, my: float, ok: bool, i: int, pixels: FloatArray, valid: BoolArray
) -> None:
    """Write the pixel of a point of the plane, or NaN."""
    ok = ok & (mx * mx + my * my <= p[11])
    valid[i] = ok
    pixels[i, 0] = p[0] * mx + p[1] * my + p[4] if ok else math.nan
    pixels[i, 1] = p[2] * mx + p[3] * my + p[5] if ok else math.nan


@inlined
def plane_point(p: FloatArray, u: float, v: float) -> tuple[float, float, bool]:
    """Return the plane's point of a pixel, and whether it is in the domain's disc."""
    u, v = u - p[4], v - p[5]
    mx, my = p[6] * u + p[7] * v, p[8] * u + p[9] * v
    square = mx * mx + my * my
    inner = p[11] * (1.0 - _INWARDS)
    shrink = math.sqrt(inner / square) if square > inner else 1.0  # rounding beyond the rim: back to it
    return shrink * mx, shrink * my, square <= p[12]


@inlined
def write_bearing(
    p: FloatArray, x: float, y: float, z: float, ok: bool, i: int, bearings: FloatArray, valid: BoolArray
) -> None:
    """Write a bearing, not beyond the largest angle by rounding, or NaN."""
    valid[i] = ok
    bearings[i, 0] = x if ok else math.nan
    bearings[i, 1] = y if ok else math.nan
    bearings[i, 2] = max(z, p[10] + 1e-15) if ok else math.nan
