"""The unified model (2) for compiled code, one point at a time.

m = (X, Y)/(Z + ξρ) with ρ = ‖(X, Y, Z)‖, then radial-tangential distortion, then K.

Every function takes ``UnifiedCamera.parameters``, a float64 array (13,), whose places are named below.
Where ``ok`` is False the numbers are NaN.
"""

import math

import numpy as np

from omniservo.geometry.arrays import BoolArray, FloatArray
from omniservo.geometry.kernel import BLOCK, inlined, kernel, leaf

FX, FY, CX, CY, SKEW, XI, K1, K2, P1, P2, COSINE, SQUARE, DISTORTED_SQUARE = range(13)
"""The places of ``UnifiedCamera.parameters``: K [px], ξ, distortion, and the domain: projection needs
Z > COSINE ρ, a usable pixel has ‖m‖² ≤ SQUARE before distortion and ≤ DISTORTED_SQUARE after it"""

X, Y, Z, XU, XV, YU, YV, ZU, ZV = range(9)
"""The places of a bearing with its derivatives ∂/∂u and ∂/∂v [1/px]"""

_NAN = math.nan
_LEAST_SQUARE = 1e-280
_LARGEST_SQUARE = 1e280
_ITERATIONS = 100
_SHORTEST_STEP = 1e-7
_ROUNDING = 4e-16
_RADIAL = 2
_SHORT = 1e-11


@inlined
def distort(parameters: FloatArray, x: float, y: float) -> tuple[float, float]:
    """Return D(m) = (1 + k1 r² + k2 r⁴) m + 2(q·m) m + r² q with q = (p2, p1) and r = ‖m‖."""
    k1, k2, p1, p2 = parameters[K1], parameters[K2], parameters[P1], parameters[P2]
    r2 = x * x + y * y
    factor = 1.0 + r2 * (k1 + r2 * k2) + 2.0 * (p2 * x + p1 * y)
    return x * factor + p2 * r2, y * factor + p1 * r2


@inlined
def distort_jacobian(parameters: FloatArray, x: float, y: float) -> tuple[float, float, float]:
    """Return ∂D/∂m as (xx, xy, yy). It is symmetric: D is the gradient of a potential."""
    k1, k2, p1, p2 = parameters[K1], parameters[K2], parameters[P1], parameters[P2]
    r2 = x * x + y * y
    factor = 1.0 + r2 * (k1 + r2 * k2)
    slope = 2.0 * (k1 + 2.0 * k2 * r2)
    return (
        factor + slope * x * x + 6.0 * p2 * x + 2.0 * p1 * y,
        slope * x * y + 2.0 * (p1 * x + p2 * y),
        factor + slope * y * y + 2.0 * p2 * x + 6.0 * p1 * y,
    )


@inlined
def _step(
    parameters: FloatArray, px: float, py: float, x: float, y: float, jacobian: tuple[float, float, float]
) -> tuple[float, float]:
    """Return Newton's step from m = (x, y) towards D(m) = (px, py)."""
    dx, dy = distort(parameters, x, y)
    jxx, jxy, jyy = jacobian
    inverse = 1.0 / (jxx * jyy - jxy * jxy)
    ex, ey = inverse * (px - dx), inverse * (py - dy)
    return jyy * ex - jxy * ey, jxx * ey - jxy * ex


@inlined
def _fixed_steps(parameters: FloatArray, px: float, py: float) -> tuple[float, float, bool]:
    """Return m with D(m) = (px, py), and whether it is that, in the disc: Newton's method without branches.

    Two steps on the radial part, two on both, two more with the Jacobian before them: where the last is short
    it ends at the last digit.
    """
    square = px * px + py * py
    k1, k2, scale = parameters[K1] * square, parameters[K2] * square * square, 1.0
    for _ in range(_RADIAL):
        t = scale * scale
        scale -= (scale * (1.0 + t * (k1 + t * k2)) - 1.0) / (1.0 + t * (3.0 * k1 + t * 5.0 * k2))
    x, y = scale * px, scale * py
    sx, sy = _step(parameters, px, py, x, y, distort_jacobian(parameters, x, y))
    x, y = x + sx, y + sy
    jacobian = distort_jacobian(parameters, x, y)
    sx, sy = _step(parameters, px, py, x, y, jacobian)
    x, y = x + sx, y + sy
    sx, sy = _step(parameters, px, py, x, y, jacobian)
    x, y = x + sx, y + sy
    sx, sy = _step(parameters, px, py, x, y, jacobian)
    x, y = x + sx, y + sy
    short = abs(sx) + abs(sy) <= _SHORT * (abs(x) + abs(y))
    return x, y, short & (x * x + y * y <= parameters[SQUARE])


@inlined
def undistort(parameters: FloatArray, px: float, py: float) -> tuple[float, float, bool]:
    """Return the one m with D(m) = (px, py) and ‖m‖² ≤ r².

    Where `_fixed_steps` do not lead there, `_undistort_slowly` decides. ``ok`` is False where the disc holds
    no such m.
    """
    square = px * px + py * py
    if parameters[K1] == 0.0 and parameters[K2] == 0.0 and parameters[P1] == 0.0 and parameters[P2] == 0.0:
        return px, py, square <= parameters[SQUARE]
    if not square <= parameters[DISTORTED_SQUARE]:
        return _NAN, _NAN, False
    x, y, ok = _fixed_steps(parameters, px, py)
    if ok:
        return x, y, True
    return _undistort_slowly(parameters, px, py)


@leaf
def _undistort_slowly(parameters: FloatArray, px: float, py: float) -> tuple[float, float, bool]:
    """Return m as `undistort` does, by Newton's method with halved steps inside the disc."""
    largest = parameters[SQUARE] * (1.0 + 1e-12)
    shrink = min(1.0, math.sqrt(largest / max(px * px + py * py, 1e-300)))
    x, y = shrink * px, shrink * py
    dx, dy = distort(parameters, x, y)
    ex, ey = px - dx, py - dy
    enough = _ROUNDING * (abs(px) + abs(py))
    for _ in range(_ITERATIONS):
        error = ex * ex + ey * ey
        if error <= enough * enough:
            break
        jxx, jxy, jyy = distort_jacobian(parameters, x, y)
        determinant = jxx * jyy - jxy * jxy
        sx, sy = (jyy * ex - jxy * ey) / determinant, (jxx * ey - jxy * ex) / determinant
        if abs(sx) + abs(sy) <= 4.0 * _ROUNDING * (abs(x) + abs(y)):
            break
        length = 1.0
        while length > _SHORTEST_STEP:
            nx, ny = x + length * sx, y + length * sy
            if nx * nx + ny * ny <= largest:
                dx, dy = distort(parameters, nx, ny)
                if (px - dx) ** 2 + (py - dy) ** 2 < error:
                    break
            length *= 0.5
        if length <= _SHORTEST_STEP:
            break
        x, y, ex, ey = nx, ny, px - dx, py - dy
    inside = x * x + y * y <= parameters[SQUARE] * (1.0 + 4e-16)
    return x, y, abs(ex) + abs(ey) <= 1e-13 * (abs(px) + abs(py)) and inside


@leaf
def project_point(parameters: FloatArray, x: float, y: float, z: float) -> tuple[float, float, bool]:
    """Return the pixel (u, v) of a point in the camera frame [m], and whether it is in the domain."""
    square = x * x + y * y + z * z
    rho = math.sqrt(square)
    denominator = z + parameters[XI] * rho
    if not (_LEAST_SQUARE < square < _LARGEST_SQUARE and z > parameters[COSINE] * rho and denominator > 0.0):
        return _NAN, _NAN, False
    inverse = 1.0 / denominator
    dx, dy = distort(parameters, x * inverse, y * inverse)
    return (
        parameters[FX] * dx + parameters[SKEW] * dy + parameters[CX],
        parameters[FY] * dy + parameters[CY],
        True,
    )


@leaf
def project_point_jacobian(
    parameters: FloatArray, x: float, y: float, z: float
) -> tuple[float, float, float, float, float, float, float, float, bool]:
    """Return (u, v, ∂u/∂X, ∂u/∂Y, ∂u/∂Z, ∂v/∂X, ∂v/∂Y, ∂v/∂Z, ok), derivatives in [px/m]."""
    square = x * x + y * y + z * z
    rho = math.sqrt(square)
    xi = parameters[XI]
    denominator = z + xi * rho
    if not (_LEAST_SQUARE < square < _LARGEST_SQUARE and z > parameters[COSINE] * rho and denominator > 0.0):
        return _NAN, _NAN, _NAN, _NAN, _NAN, _NAN, _NAN, _NAN, False
    inverse = 1.0 / denominator
    mx, my = x * inverse, y * inverse
    # the denominator's derivative, already divided by the denominator
    gx, gy, gz = inverse * xi * x / rho, inverse * xi * y / rho, inverse * (1.0 + xi * z / rho)
    px, py = distort(parameters, mx, my)
    jxx, jxy, jyy = distort_jacobian(parameters, mx, my)
    fx, fy, skew = parameters[FX], parameters[FY], parameters[SKEW]
    ux, uy = fx * jxx + skew * jxy, fx * jxy + skew * jyy
    vx, vy = fy * jxy, fy * jyy
    um, vm = ux * mx + uy * my, vx * mx + vy * my
    return (
        fx * px + skew * py + parameters[CX],
        fy * py + parameters[CY],
        ux * inverse - um * gx,
        uy * inverse - um * gy,
        -um * gz,
        vx * inverse - vm * gx,
        vy * inverse - vm * gy,
        -vm * gz,
        True,
    )


@leaf
def unproject_plane(parameters: FloatArray, mx: float, my: float) -> tuple[float, float, float]:
    """Return the bearing of a point m of the normalised plane inside the domain of unprojection.

    s = (η m_x, η m_y, η − ξ) with η = (ξ + √(1 + (1−ξ²) r²))/(1 + r²). Rounding at the very rim cannot
    push the bearing out of the domain of projection.
    """
    xi = parameters[XI]
    r2 = mx * mx + my * my
    eta = (xi + math.sqrt(max(0.0, 1.0 + (1.0 - xi) * (1.0 + xi) * r2))) / (1.0 + r2)
    return eta * mx, eta * my, max(eta - xi, parameters[COSINE] + 1e-15)


@inlined
def _bearing_of_pixel(parameters: FloatArray, u: float, v: float) -> tuple[float, float, float, bool]:
    """Return what `unproject_pixel` does; a part of the loop below, which is the faster for it."""
    py = (v - parameters[CY]) / parameters[FY]
    px = (u - parameters[CX] - parameters[SKEW] * py) / parameters[FX]
    mx, my, ok = undistort(parameters, px, py)
    if not (ok and mx * mx + my * my < _LARGEST_SQUARE):
        return _NAN, _NAN, _NAN, False
    x, y, z = unproject_plane(parameters, mx, my)
    return x, y, z, True


@leaf
def unproject_pixel(parameters: FloatArray, u: float, v: float) -> tuple[float, float, float, bool]:
    """Return the bearing (unit) of a pixel, and whether the pixel is in the domain."""
    return _bearing_of_pixel(parameters, u, v)


@leaf
def unproject_pixel_jacobian(parameters: FloatArray, u: float, v: float, out: FloatArray) -> bool:
    """Write the bearing and ∂bearing/∂(u, v) [1/px] into ``out`` (9,): X, Y, Z, XU, XV, YU, YV, ZU, ZV.

    Returns False, and writes NaN, outside the domain and on its rim, where the derivative is infinite.
    """
    out[:] = _NAN
    fx, fy, skew = parameters[FX], parameters[FY], parameters[SKEW]
    py = (v - parameters[CY]) / fy
    mx, my, ok = undistort(parameters, (u - parameters[CX] - skew * py) / fx, py)
    xi = parameters[XI]
    r2 = mx * mx + my * my
    radicand = 1.0 + (1.0 - xi) * (1.0 + xi) * r2
    if not (ok and radicand > 0.0 and r2 < _LARGEST_SQUARE):
        return False
    root = math.sqrt(radicand)
    eta = (xi + root) / (1.0 + r2)
    slope = ((1.0 - xi) * (1.0 + xi) / root - 2.0 * eta) / (1.0 + r2)  # 2 dη/d(r²)
    jxx, jxy, jyy = distort_jacobian(parameters, mx, my)
    determinant = jxx * jyy - jxy * jxy
    xu, yu = jyy / (determinant * fx), -jxy / (determinant * fx)
    xv = (-jxy / determinant - skew * xu) / fy
    yv = (jxx / determinant - skew * yu) / fy
    eu, ev = slope * (mx * xu + my * yu), slope * (mx * xv + my * yv)
    out[X], out[Y], out[Z] = unproject_plane(parameters, mx, my)
    out[XU], out[XV] = eta * xu + mx * eu, eta * xv + mx * ev
    out[YU], out[YV] = eta * yu + my * eu, eta * yv + my * ev
    out[ZU], out[ZV] = eu, ev
    return True


@leaf
def project_points(parameters: FloatArray, points: FloatArray, pixels: FloatArray, valid: BoolArray) -> None:
    """`project_point` for each row of ``points`` (n, 3) into ``pixels`` (n, 2) and ``valid`` (n,)."""
    for i in range(points.shape[0]):
        pixels[i, 0], pixels[i, 1], valid[i] = project_point(
            parameters, points[i, 0], points[i, 1], points[i, 2]
        )


@leaf
def project_points_jacobian(
    parameters: FloatArray, points: FloatArray, pixels: FloatArray, jacobians: FloatArray, valid: BoolArray
) -> None:
    """`project_point_jacobian` for each row of ``points`` (n, 3); ``jacobians`` is (n, 2, 3)."""
    for i in range(points.shape[0]):
        u, v, ux, uy, uz, vx, vy, vz, ok = project_point_jacobian(
            parameters, points[i, 0], points[i, 1], points[i, 2]
        )
        pixels[i, 0], pixels[i, 1], valid[i] = u, v, ok
        jacobians[i, 0, 0], jacobians[i, 0, 1], jacobians[i, 0, 2] = ux, uy, uz
        jacobians[i, 1, 0], jacobians[i, 1, 1], jacobians[i, 1, 2] = vx, vy, vz


@leaf
def _undistort_block(
    parameters: FloatArray, px: FloatArray, py: FloatArray, x: FloatArray, y: FloatArray
) -> None:
    """`undistort` for a block of distorted points; x is NaN where it is not ok."""
    for i in range(px.shape[0]):
        mx, my, ok = _fixed_steps(parameters, px[i], py[i])
        x[i], y[i] = mx if ok else _NAN, my
    for i in range(px.shape[0]):
        if x[i] != x[i] and px[i] * px[i] + py[i] * py[i] <= parameters[DISTORTED_SQUARE]:
            mx, y[i], ok = _undistort_slowly(parameters, px[i], py[i])
            x[i] = mx if ok else _NAN


@kernel
def unproject_pixels(
    parameters: FloatArray, pixels: FloatArray, bearings: FloatArray, valid: BoolArray
) -> None:
    """`unproject_pixel` for each row of ``pixels`` (n, 2) into ``bearings`` (n, 3) and ``valid`` (n,)."""
    fx, fy, cx, cy, skew = parameters[FX], parameters[FY], parameters[CX], parameters[CY], parameters[SKEW]
    straight = not parameters[K1 : P2 + 1].any()
    most = min(parameters[SQUARE], _LARGEST_SQUARE) if straight else _LARGEST_SQUARE
    block_u, block_v, block_x, block_y = np.empty(BLOCK), np.empty(BLOCK), np.empty(BLOCK), np.empty(BLOCK)
    for start in range(0, pixels.shape[0], BLOCK):
        rows = pixels[start : start + BLOCK]
        n = rows.shape[0]
        u, v, x, y = block_u[:n], block_v[:n], block_x[:n], block_y[:n]
        for i in range(n):
            y[i] = (rows[i, 1] - cy) / fy
            x[i] = (rows[i, 0] - cx - skew * y[i]) / fx
        if not straight:
            u[:], v[:] = x, y
            _undistort_block(parameters, u, v, x, y)
        for i in range(n):
            mx = x[i] if x[i] * x[i] + y[i] * y[i] <= most else _NAN
            x[i], y[i], u[i] = unproject_plane(parameters, mx, y[i])
        for i in range(n):
            ok = x[i] == x[i]
            valid[start + i] = ok
            bearings[start + i, 0] = x[i]
            bearings[start + i, 1] = y[i] if ok else _NAN
            bearings[start + i, 2] = u[i] if ok else _NAN


@leaf
def unproject_pixels_jacobian(
    parameters: FloatArray, pixels: FloatArray, results: FloatArray, valid: BoolArray
) -> None:
    """`unproject_pixel_jacobian` for each row of ``pixels`` (n, 2); ``results`` is (n, 9)."""
    for i in range(pixels.shape[0]):
        valid[i] = unproject_pixel_jacobian(parameters, pixels[i, 0], pixels[i, 1], results[i])
