"""What all models' loops share: the domain's tests, and the affine map between the plane and pixels.

Conditions are joined by ``&``, which is no branch: a branch in these loops makes them three times slower.
"""

import math

from omniservo.geometry.arrays import BoolArray, FloatArray
from omniservo.geometry.kernel import inlined

XX, XY, YX, YY, CX, CY, INVERSE_XX, INVERSE_XY, INVERSE_YX, INVERSE_YY = range(10)
"""The first places of a lens's ``parameters``: the affine map from the plane to pixels, matrix row by row,
offset [px] and inverse matrix"""

COSINE, SQUARE, WIDER_SQUARE = range(10, 13)
"""The next: the least Z/ρ, the largest ‖m‖², and the same with what rounding needs"""

OWN = 13
"""where the model's own parameters start"""

_LEAST_SQUARE = 1e-280
_LARGEST_SQUARE = 1e280
_INWARDS = 6e-14
"""on ‖m‖²: what is unprojected lies so far inside the largest that is projected"""


@inlined
def distance_in_domain(p: FloatArray, x: float, y: float, z: float) -> tuple[float, bool]:
    """Return ρ = ‖(x, y, z)‖, and whether the point's angle from the axis is in the domain."""
    square = x * x + y * y + z * z
    rho = math.sqrt(square)
    return rho, (square > _LEAST_SQUARE) & (square < _LARGEST_SQUARE) & (z > p[COSINE] * rho)


@inlined
def write_pixel(
    p: FloatArray, mx: float, my: float, ok: bool, i: int, pixels: FloatArray, valid: BoolArray
) -> None:
    """Write the pixel of a point of the plane, or NaN."""
    ok = ok & (mx * mx + my * my <= p[SQUARE])
    valid[i] = ok
    pixels[i, 0] = p[XX] * mx + p[XY] * my + p[CX] if ok else math.nan
    pixels[i, 1] = p[YX] * mx + p[YY] * my + p[CY] if ok else math.nan


@inlined
def plane_point(p: FloatArray, u: float, v: float) -> tuple[float, float, bool]:
    """Return the plane's point of a pixel, and whether it is in the domain's disc."""
    u, v = u - p[CX], v - p[CY]
    mx, my = p[INVERSE_XX] * u + p[INVERSE_XY] * v, p[INVERSE_YX] * u + p[INVERSE_YY] * v
    square = mx * mx + my * my
    inner = p[SQUARE] * (1.0 - _INWARDS)
    shrink = math.sqrt(inner / square) if square > inner else 1.0  # rounding beyond the rim: back to it
    return shrink * mx, shrink * my, square <= p[WIDER_SQUARE]


@inlined
def write_bearing(
    p: FloatArray, x: float, y: float, z: float, ok: bool, i: int, bearings: FloatArray, valid: BoolArray
) -> None:
    """Write a bearing, not beyond the largest angle by rounding, or NaN."""
    valid[i] = ok
    bearings[i, 0] = x if ok else math.nan
    bearings[i, 1] = y if ok else math.nan
    bearings[i, 2] = max(z, p[COSINE] + 1e-15) if ok else math.nan
