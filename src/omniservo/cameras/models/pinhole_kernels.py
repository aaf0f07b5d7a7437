"""OpenCV's distortion, block by block: rational, tangential, thin prism, tilt.

Every function takes a lens's ``parameters``; `plane_kernels` names the places that all models share.
"""

import math

import numpy as np

from omniservo.cameras.models.block_kernels import project_blocks, read_pixels, write_bearings
from omniservo.cameras.models.plane_kernels import (
    COSINE,
    CX,
    CY,
    INVERSE_XX,
    INVERSE_XY,
    INVERSE_YX,
    INVERSE_YY,
    OWN,
)
from omniservo.cameras.models.radial_kernels import TABLE, table_value
from omniservo.geometry.arrays import BoolArray, FloatArray
from omniservo.geometry.kernel import BLOCK, inlined, kernel, leaf

DISC, PER_STEP, REACH, KIND = range(OWN, OWN + 4)
"""The places of the largest ‖m‖², 1/step of the table, a bound of ‖D(m)‖², and 0 plain, 1 distorted,
2 distorted and tilted"""

K1, K2, P1, P2, K3, K4, K5, K6, S1, S2, S3, S4, TAU_X, TAU_Y = range(KIND + 1, KIND + 15)
"""of the coefficients, in OpenCV's order"""

TILT_XX, TILT_XY, TILT_X, TILT_YX, TILT_YY, TILT_Y, TILT_WX, TILT_WY, TILT_W = range(TAU_Y + 1, TAU_Y + 10)
"""of the tilt T, row by row: (x, y, 1) goes to (x, y, w)"""

UNTILT_XX, UNTILT_XY, UNTILT_X, UNTILT_YX, UNTILT_YY, UNTILT_Y, UNTILT_WX, UNTILT_WY, UNTILT_W = range(
    TILT_W + 1, TILT_W + 10
)
"""of T⁻¹"""

START = UNTILT_W + 1
"""where the table starts: r at equal steps of the radial part of ‖D‖, then dr per step"""

_STEPS = 60
_SHORTEST_STEP = 1e-6
_SHORT = 1e-11
_ROUNDING = 4e-16
_RIM = 1.0 + 1e-12
"""on ‖m‖²: rounding beyond the largest; such a point is moved back to the rim"""


@inlined
def _inverse_below(p: FloatArray, r2: float) -> float:
    """Return 1/(1 + k4r² + k5r⁴ + k6r⁶)."""
    return float(1.0 / (1.0 + r2 * (p[K4] + r2 * (p[K5] + r2 * p[K6]))))


@inlined
def distort(p: FloatArray, x: float, y: float) -> tuple[float, float]:
    """Return D(m) without tilt: radial factor, tangential and thin prism parts."""
    r2 = x * x + y * y
    radial = (1.0 + r2 * (p[K1] + r2 * (p[K2] + r2 * p[K3]))) * _inverse_below(p, r2)
    factor = radial + 2.0 * (p[P2] * x + p[P1] * y)
    return (
        x * factor + r2 * (p[P2] + p[S1] + r2 * p[S2]),
        y * factor + r2 * (p[P1] + p[S3] + r2 * p[S4]),
    )


@inlined
def distort_jacobian(p: FloatArray, x: float, y: float) -> tuple[float, float, float, float]:
    """Return ∂D/∂m as (xx, xy, yx, yy); the thin prism alone makes it unsymmetric."""
    r2 = x * x + y * y
    above = 1.0 + r2 * (p[K1] + r2 * (p[K2] + r2 * p[K3]))
    below = _inverse_below(p, r2)
    radial = above * below
    up = p[K1] + r2 * (2.0 * p[K2] + 3.0 * r2 * p[K3])
    down = p[K4] + r2 * (2.0 * p[K5] + 3.0 * r2 * p[K6])
    slope = 2.0 * (up - radial * down) * below  # ∂radial/∂m = slope · m
    factor = radial + 2.0 * (p[P2] * x + p[P1] * y)
    px = 2.0 * (p[P2] + p[S1] + 2.0 * r2 * p[S2])
    py = 2.0 * (p[P1] + p[S3] + 2.0 * r2 * p[S4])
    return (
        factor + x * (slope * x + 2.0 * p[P2]) + px * x,
        x * (slope * y + 2.0 * p[P1]) + px * y,
        y * (slope * x + 2.0 * p[P2]) + py * x,
        factor + y * (slope * y + 2.0 * p[P1]) + py * y,
    )


@inlined
def _newton(
    p: FloatArray, px: float, py: float, x: float, y: float, inverse: tuple[float, float, float, float]
) -> tuple[float, float]:
    """Return the step from m = (x, y) towards D(m) = (px, py), by an inverse Jacobian (xx, xy, yx, yy)."""
    dx, dy = distort(p, x, y)
    ex, ey = px - dx, py - dy
    return inverse[0] * ex + inverse[1] * ey, inverse[2] * ex + inverse[3] * ey


@inlined
def _inverse_jacobian(p: FloatArray, x: float, y: float) -> tuple[float, float, float, float]:
    """Return (∂D/∂m)⁻¹ as (xx, xy, yx, yy)."""
    xx, xy, yx, yy = distort_jacobian(p, x, y)
    scale = 1.0 / (xx * yy - xy * yx)
    return scale * yy, -scale * xy, -scale * yx, scale * xx


@leaf
def _undistort(p: FloatArray, px: FloatArray, py: FloatArray, x: FloatArray, y: FloatArray) -> None:
    """Write the m with D(m) = (px, py) in the disc; x is NaN where there is none.

    Newton's method from the radial part's inverse, two steps and two more with the Jacobian before them:
    where the last is short it ends at the last digit. Where it is not, or at the rim, `_undistort_slowly`
    decides.
    """
    per_step, reach = p[PER_STEP], p[REACH]
    for i in range(px.shape[0]):
        square = px[i] * px[i] + py[i] * py[i]
        place = min(math.sqrt(square) * per_step, TABLE - 1e-9)
        x[i] = place if square <= reach else 0.0
    for i in range(px.shape[0]):
        x[i], _, _ = table_value(p, START, x[i])
    for i in range(px.shape[0]):
        r = math.sqrt(px[i] * px[i] + py[i] * py[i])
        scale = x[i] / (r if r > 0.0 else 1.0)
        mx, my = scale * px[i], scale * py[i]
        sx, sy = _newton(p, px[i], py[i], mx, my, _inverse_jacobian(p, mx, my))
        mx, my = mx + sx, my + sy
        inverse = _inverse_jacobian(p, mx, my)
        sx, sy = _newton(p, px[i], py[i], mx, my, inverse)
        mx, my = mx + sx, my + sy
        sx, sy = _newton(p, px[i], py[i], mx, my, inverse)
        mx, my = mx + sx, my + sy
        sx, sy = _newton(p, px[i], py[i], mx, my, inverse)
        mx, my = mx + sx, my + sy
        short = abs(sx) + abs(sy) <= _SHORT * (abs(mx) + abs(my))
        x[i], y[i] = mx if short & (mx * mx + my * my <= p[DISC]) else math.nan, my
    for i in range(px.shape[0]):
        if x[i] != x[i] and px[i] * px[i] + py[i] * py[i] <= reach:
            x[i], y[i] = _undistort_slowly(p, px[i], py[i])


@leaf
def _undistort_slowly(p: FloatArray, px: float, py: float) -> tuple[float, float]:
    """Return the one m with D(m) = (px, py) in the disc or NaN, by Newton's method with halved steps."""
    r = math.sqrt(px * px + py * py)
    radius, _, _ = table_value(p, START, min(r * p[PER_STEP], TABLE - 1e-9))
    x, y = radius / r * px, radius / r * py
    dx, dy = distort(p, x, y)
    ex, ey = px - dx, py - dy
    largest = p[DISC] * _RIM
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
    square = x * x + y * y
    shrink = math.sqrt(p[DISC] / square) if square > p[DISC] else 1.0
    return shrink * x if ok & (square <= p[DISC] * _RIM) else math.nan, shrink * y


@leaf
def _untilt(p: FloatArray, x: FloatArray, y: FloatArray) -> None:
    """Replace points of the tilted sensor by those before it, T⁻¹ m."""
    for i in range(x.shape[0]):
        w = p[UNTILT_WX] * x[i] + p[UNTILT_WY] * y[i] + p[UNTILT_W]
        mx, my = (
            p[UNTILT_XX] * x[i] + p[UNTILT_XY] * y[i] + p[UNTILT_X],
            p[UNTILT_YX] * x[i] + p[UNTILT_YY] * y[i] + p[UNTILT_Y],
        )
        x[i], y[i] = mx / w if w > 0.0 else math.nan, my / w


@leaf
def _distort(p: FloatArray, x: FloatArray, y: FloatArray, z: FloatArray) -> None:
    """Replace points by T D(X/Z, Y/Z); x is NaN where Z ≤ 0 or (X/Z, Y/Z) is not in the disc."""
    for i in range(x.shape[0]):
        mx, my = x[i] / z[i], y[i] / z[i]
        ok = (z[i] > 0.0) & (mx * mx + my * my <= p[DISC] * (1.0 + 1e-13))
        mx, my = distort(p, mx, my)
        x[i], y[i] = mx if ok else math.nan, my
    if p[KIND] > 1.0:
        for i in range(x.shape[0]):
            w = p[TILT_WX] * x[i] + p[TILT_WY] * y[i] + p[TILT_W]
            mx, my = (
                p[TILT_XX] * x[i] + p[TILT_XY] * y[i] + p[TILT_X],
                p[TILT_YX] * x[i] + p[TILT_YY] * y[i] + p[TILT_Y],
            )
            x[i], y[i] = mx / w, my / w


@kernel
def project_pinhole(p: FloatArray, points: FloatArray, pixels: FloatArray, valid: BoolArray) -> None:
    """Project each row of ``points`` (n, 3) into ``pixels`` (n, 2) and ``valid`` (n,)."""
    project_blocks(_distort, p, points, pixels, valid)


@leaf
def _unproject_straight(p: FloatArray, pixels: FloatArray, bearings: FloatArray, valid: BoolArray) -> None:
    """`unproject_pinhole` without distortion: as the memory is the limit, all in one loop."""
    cx, cy, xx, xy = p[CX], p[CY], p[INVERSE_XX], p[INVERSE_XY]
    yx, yy = p[INVERSE_YX], p[INVERSE_YY]
    most, least = p[DISC], p[COSINE] + 1e-15
    for i in range(pixels.shape[0]):
        u, v = pixels[i, 0] - cx, pixels[i, 1] - cy
        x, y = xx * u + xy * v, yx * u + yy * v
        square = x * x + y * y
        shrink = math.sqrt(most / square) if square > most else 1.0
        z = 1.0 / math.sqrt(min(square, most) + 1.0)
        z = z if square <= most * _RIM else math.nan
        valid[i] = z == z
        bearings[i, 0], bearings[i, 1], bearings[i, 2] = z * shrink * x, z * shrink * y, max(z, least)


@kernel
def unproject_pinhole(p: FloatArray, pixels: FloatArray, bearings: FloatArray, valid: BoolArray) -> None:
    """Unproject each row of ``pixels`` (n, 2) into ``bearings`` (n, 3) and ``valid`` (n,)."""
    if p[KIND] == 0.0:
        _unproject_straight(p, pixels, bearings, valid)
        return
    block_u, block_v, block_x, block_y = np.empty(BLOCK), np.empty(BLOCK), np.empty(BLOCK), np.empty(BLOCK)
    for start in range(0, pixels.shape[0], BLOCK):
        stop = min(start + BLOCK, pixels.shape[0])
        u, v = block_u[: stop - start], block_v[: stop - start]
        x, y = block_x[: stop - start], block_y[: stop - start]
        read_pixels(p, pixels[start:stop], u, v)
        if p[KIND] > 1.0:
            _untilt(p, u, v)
        _undistort(p, u, v, x, y)
        for i in range(x.shape[0]):
            u[i] = 1.0 / math.sqrt(x[i] * x[i] + y[i] * y[i] + 1.0)
            x[i], y[i] = u[i] * x[i], u[i] * y[i]
        write_bearings(p, x, y, u, bearings[start:stop], valid[start:stop])
