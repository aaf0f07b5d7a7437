"""OpenCV's distortion, one point at a time: rational, tangential, thin prism, tilt.

Every function takes a lens's ``parameters``; `lens_model` says what stands in the first 13, and its own are

| | |
|---|---|
| 13, 15 | largest ‖m‖², a bound of ‖D(m)‖² |
| 14 | 1/step of the table |
| 16 | 0 plain, 1 distorted, 2 distorted and tilted |
| 17 … 28 | k1 k2 p1 p2 k3 k4 k5 k6 s1 s2 s3 s4 |
| 31 … 39, 40 … 48 | tilt T row by row, T⁻¹ |
| from 49 on | r at equal steps of the radial part of ‖D‖ |
"""

import math

from omniservo.cameras.models.plane_kernels import (
    distance_in_domain,
    plane_point,
    write_bearing,
    write_pixel,
)
from omniservo.cameras.models.radial_kernels import TABLE, table_value
from omniservo.geometry.arrays import BoolArray, FloatArray
from omniservo.geometry.kernel import inlined, kernel

OWN = 17
"""where the coefficients start"""

TILT = 31
"""where T starts; T⁻¹ follows"""

START = 49
"""where the table starts"""

_STEPS = 60
_SHORTEST_STEP = 1e-6
_FAST = 3
_SHORT = 1e-11
_ROUNDING = 4e-16


@inlined
def _inverse_below(p: FloatArray, r2: float) -> float:
    """Return 1/(1 + k4r² + k5r⁴ + k6r⁶)."""
    below = r2 * (p[22] + r2 * (p[23] + r2 * p[24]))
    return 1.0 / (1.0 + below) if below != 0.0 else 1.0


@inlined
def distort(p: FloatArray, x: float, y: float) -> tuple[float, float]:
    """Return D(m) without tilt: radial factor, tangential and thin prism parts."""
    r2 = x * x + y * y
    radial = (1.0 + r2 * (p[17] + r2 * (p[18] + r2 * p[21]))) * _inverse_below(p, r2)
    factor = radial + 2.0 * (p[20] * x + p[19] * y)
    return (
        x * factor + r2 * (p[20] + p[25] + r2 * p[26]),
        y * factor + r2 * (p[19] + p[27] + r2 * p[28]),
    )


@inlined
def distort_jacobian(p: FloatArray, x: float, y: float) -> tuple[float, float, float, float]:
    """Return ∂D/∂m as (xx, xy, yx, yy); the thin prism alone makes it unsymmetric."""
    r2 = x * x + y * y
    above = 1.0 + r2 * (p[17] + r2 * (p[18] + r2 * p[21]))
    below = _inverse_below(p, r2)
    radial = above * below
    up = p[17] + r2 * (2.0 * p[18] + 3.0 * r2 * p[21])
    down = p[22] + r2 * (2.0 * p[23] + 3.0 * r2 * p[24])
    slope = 2.0 * (up - radial * down) * below  # ∂radial/∂m = slope · m
    factor = radial + 2.0 * (p[20] * x + p[19] * y)
    px = 2.0 * (p[20] + p[25] + 2.0 * r2 * p[26])
    py = 2.0 * (p[19] + p[27] + 2.0 * r2 * p[28])
    return (
        factor + x * (slope * x + 2.0 * p[20]) + px * x,
        x * (slope * y + 2.0 * p[19]) + px * y,
        y * (slope * x + 2.0 * p[20]) + py * x,
        factor + y * (slope * y + 2.0 * p[19]) + py * y,
    )


@inlined
def undistort(p: FloatArray, px: float, py: float) -> tuple[float, float, bool]:
    """Return the one m with D(m) = (px, py) in the disc: Newton's method from the radial part's inverse.

    Every third step takes the Jacobian before it: where that one is short it ends at the last digit. Where it
    is not soon, or outside the disc, `_undistort_slowly` decides.
    """
    square = px * px + py * py
    if not square <= p[15]:
        return math.nan, math.nan, False
    if square == 0.0:
        return px, py, True
    r = math.sqrt(square)
    radius, _, _ = table_value(p, START, min(r * p[14], TABLE - 1e-9))
    x, y = radius / r * px, radius / r * py
    for _ in range(_FAST):
        xx, xy, yx, yy, inverse = 1.0, 0.0, 0.0, 1.0, 1.0
        sx, sy = 0.0, 0.0
        for step in range(3):
            dx, dy = distort(p, x, y)
            if step < 2:
                xx, xy, yx, yy = distort_jacobian(p, x, y)
                inverse = 1.0 / (xx * yy - xy * yx)
            sx = (yy * (px - dx) - xy * (py - dy)) * inverse
            sy = (xx * (py - dy) - yx * (px - dx)) * inverse
            x, y = x + sx, y + sy
        if abs(sx) + abs(sy) <= _SHORT * (abs(x) + abs(y)):
            if x * x + y * y <= p[13] * (1.0 + 1e-12):
                return x, y, True
            break
    return _undistort_slowly(p, px, py, radius / r)


@kernel
def _undistort_slowly(p: FloatArray, px: float, py: float, scale: float) -> tuple[float, float, bool]:
    """Return the one m with D(m) = (px, py) in the disc, by Newton's method with halved steps inside it."""
    x, y = scale * px, scale * py
    dx, dy = distort(p, x, y)
    ex, ey = px - dx, py - dy
    largest = p[13] * (1.0 + 1e-12)
    enough = _ROUNDING * (abs(px) + abs(py))
    for _ in range(_STEPS):
        error = ex * ex + ey * ey
        if error <= enough * enough:
            break
        xx, xy, yx, yy = distort_jacobian(p, x, y)
        inverse = 1.0 / (xx * yy - xy * yx)
        sx, sy = (yy * ex - xy * ey) * inverse, (xx * ey - yx * ex) * inverse
        length = 1.0
        while length > _SHORTEST_STEP:
            nx, ny = x + length * sx, y + length * sy
            if nx * nx + ny * ny <= largest:
                dx, dy = distort(p, nx, ny)
                if (px - dx) ** 2 + (py - dy) ** 2 < error:
                    break
            length *= 0.5
        if length <= _SHORTEST_STEP:
            break
        x, y, ex, ey = nx, ny, px - dx, py - dy
    ok = abs(ex) + abs(ey) <= 1e-13 * (abs(px) + abs(py))
    return x, y, ok


@inlined
def pinhole_plane(p: FloatArray, x: float, y: float, z: float) -> tuple[float, float, bool]:
    """Return T D(X/Z, Y/Z) where Z > 0 and (X/Z, Y/Z) is in the disc."""
    if not z > 0.0:
        return math.nan, math.nan, False
    mx, my = x / z, y / z
    if not mx * mx + my * my <= p[13] * (1.0 + 1e-13):
        return math.nan, math.nan, False
    if p[16] > 0.0:
        mx, my = distort(p, mx, my)
        if p[16] > 1.0:
            w = p[37] * mx + p[38] * my + p[39]
            mx, my = (p[31] * mx + p[32] * my + p[33]) / w, (p[34] * mx + p[35] * my + p[36]) / w
    return mx, my, True


@inlined
def pinhole_bearing(p: FloatArray, mx: float, my: float) -> tuple[float, float, float, bool]:
    """Return the unit vector along (D⁻¹(T⁻¹ m), 1)."""
    ok = True
    if p[16] > 0.0:
        if p[16] > 1.0:
            w = p[46] * mx + p[47] * my + p[48]
            if not w > 0.0:
                return math.nan, math.nan, math.nan, False
            mx, my = (p[40] * mx + p[41] * my + p[42]) / w, (p[43] * mx + p[44] * my + p[45]) / w
        mx, my, ok = undistort(p, mx, my)
    square = mx * mx + my * my
    if square > p[13]:
        ok = ok and square <= p[13] * (1.0 + 1e-12)
        shrink = math.sqrt(p[13] / square)
        mx, my, square = shrink * mx, shrink * my, p[13]
    scale = 1.0 / math.sqrt(square + 1.0)
    return scale * mx, scale * my, scale, ok


@kernel
def project_pinhole(p: FloatArray, points: FloatArray, pixels: FloatArray, valid: BoolArray) -> None:
    """Project each row of ``points`` (n, 3) into ``pixels`` (n, 2) and ``valid`` (n,)."""
    for i in range(points.shape[0]):
        x, y, z = points[i, 0], points[i, 1], points[i, 2]
        _, ok = distance_in_domain(p, x, y, z)
        mx, my = math.nan, math.nan
        if ok:
            mx, my, ok = pinhole_plane(p, x, y, z)
        write_pixel(p, mx, my, ok, i, pixels, valid)


@kernel
def unproject_pinhole(p: FloatArray, pixels: FloatArray, bearings: FloatArray, valid: BoolArray) -> None:
    """Unproject each row of ``pixels`` (n, 2) into ``bearings`` (n, 3) and ``valid`` (n,)."""
    for i in range(pixels.shape[0]):
        mx, my, ok = plane_point(p, pixels[i, 0], pixels[i, 1])
        x, y, z = math.nan, math.nan, math.nan
        if ok:
            x, y, z, ok = pinhole_bearing(p, mx, my)
        write_bearing(p, x, y, z, ok, i, bearings, valid)
