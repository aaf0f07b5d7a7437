"""The unified model, one point at a time, for compiled loops of every room.

parameters = [fx, fy, cx, cy, skew, ξ, k1, k2, p1, p2, least Z/ρ, largest r²].
"""

import math

from omniservo.geometry.arrays import BoolArray, FloatArray
from omniservo.geometry.kernel import kernel

NAN = math.nan


@kernel
def distort(parameters: FloatArray, x: float, y: float) -> tuple[float, float]:
    """Radial-tangential distortion of a point of the normalised plane."""
    k1, k2, p1, p2 = parameters[6], parameters[7], parameters[8], parameters[9]
    r2 = x * x + y * y
    radial = 1.0 + r2 * (k1 + r2 * k2)
    return (
        x * radial + 2.0 * p1 * x * y + p2 * (r2 + 2.0 * x * x),
        y * radial + p1 * (r2 + 2.0 * y * y) + 2.0 * p2 * x * y,
    )


@kernel
def distort_jacobian(parameters: FloatArray, x: float, y: float) -> tuple[float, float, float, float]:
    """Its derivative (xx, xy, yx, yy)."""
    k1, k2, p1, p2 = parameters[6], parameters[7], parameters[8], parameters[9]
    r2 = x * x + y * y
    radial = 1.0 + r2 * (k1 + r2 * k2)
    slope = 2.0 * (k1 + 2.0 * k2 * r2)
    cross = slope * x * y + 2.0 * p1 * x + 2.0 * p2 * y
    return (
        radial + slope * x * x + 2.0 * p1 * y + 6.0 * p2 * x,
        cross,
        cross,
        radial + slope * y * y + 6.0 * p1 * y + 2.0 * p2 * x,
    )


@kernel
def project_point(parameters: FloatArray, x: float, y: float, z: float) -> tuple[float, float, bool]:
    """Pixel of a point in the camera frame, and whether it lies in the camera's domain."""
    rho = math.sqrt(x * x + y * y + z * z)
    denominator = z + parameters[5] * rho
    if not (rho > 0.0 and z > parameters[10] * rho and denominator > 0.0):
        return NAN, NAN, False
    mx, my = distort(parameters, x / denominator, y / denominator)
    return (
        parameters[0] * mx + parameters[4] * my + parameters[2],
        parameters[1] * my + parameters[3],
        True,
    )


@kernel
def project_point_jacobian(
    parameters: FloatArray, x: float, y: float, z: float
) -> tuple[float, float, float, float, float, float, float, float, bool]:
    """Pixel and its derivative by the point, rows u then v."""
    rho = math.sqrt(x * x + y * y + z * z)
    xi = parameters[5]
    d = z + xi * rho
    if not (rho > 0.0 and z > parameters[10] * rho and d > 0.0):
        return NAN, NAN, NAN, NAN, NAN, NAN, NAN, NAN, False
    mx, my = x / d, y / d
    dx, dy, dz = xi * x / rho, xi * y / rho, 1.0 + xi * z / rho
    ax, ay, az = (1.0 - mx * dx) / d, -mx * dy / d, -mx * dz / d
    bx, by, bz = -my * dx / d, (1.0 - my * dy) / d, -my * dz / d
    jxx, jxy, jyx, jyy = distort_jacobian(parameters, mx, my)
    px, py = distort(parameters, mx, my)
    fx, fy, s = parameters[0], parameters[1], parameters[4]
    uxx, uxy = fx * jxx + s * jyx, fx * jxy + s * jyy
    vxx, vxy = fy * jyx, fy * jyy
    return (
        fx * px + s * py + parameters[2],
        fy * py + parameters[3],
        uxx * ax + uxy * bx,
        uxx * ay + uxy * by,
        uxx * az + uxy * bz,
        vxx * ax + vxy * bx,
        vxx * ay + vxy * by,
        vxx * az + vxy * bz,
        True,
    )


@kernel
def undistort(parameters: FloatArray, px: float, py: float) -> tuple[float, float, bool]:
    """The point of the normalised plane that is distorted to (px, py): Newton, verified."""
    if parameters[6] == 0.0 and parameters[7] == 0.0 and parameters[8] == 0.0 and parameters[9] == 0.0:
        return px, py, True
    x, y = px, py
    radius = math.sqrt(parameters[11])
    for _ in range(50):
        r = math.hypot(x, y)
        if r > radius:
            x, y = x * radius / r, y * radius / r
        ex, ey = distort(parameters, x, y)
        ex, ey = px - ex, py - ey
        jxx, jxy, jyx, jyy = distort_jacobian(parameters, x, y)
        determinant = jxx * jyy - jxy * jyx
        if determinant <= 0.0:
            return NAN, NAN, False
        sx, sy = (jyy * ex - jxy * ey) / determinant, (jxx * ey - jyx * ex) / determinant
        x, y = x + sx, y + sy
        if abs(sx) + abs(sy) < 1e-15 * (1.0 + abs(x) + abs(y)):
            break
    ex, ey = distort(parameters, x, y)
    ok = abs(ex - px) + abs(ey - py) < 1e-12 * (1.0 + abs(px) + abs(py)) and x * x + y * y <= parameters[11]
    return x, y, ok


@kernel
def unproject_pixel(parameters: FloatArray, u: float, v: float) -> tuple[float, float, float, bool]:
    """Bearing of a pixel, and whether it lies in the camera's domain."""
    py = (v - parameters[3]) / parameters[1]
    px = (u - parameters[2] - parameters[4] * py) / parameters[0]
    x, y, ok = undistort(parameters, px, py)
    r2 = x * x + y * y
    xi = parameters[5]
    radicand = 1.0 + (1.0 - xi * xi) * r2
    if not (ok and radicand >= 0.0 and r2 <= parameters[11]):
        return NAN, NAN, NAN, False
    eta = (xi + math.sqrt(radicand)) / (1.0 + r2)
    return eta * x, eta * y, eta - xi, True


@kernel
def project_points(parameters: FloatArray, points: FloatArray, pixels: FloatArray, valid: BoolArray) -> None:
    """`project_point` for each row of (n, 3)."""
    for i in range(points.shape[0]):
        pixels[i, 0], pixels[i, 1], valid[i] = project_point(
            parameters, points[i, 0], points[i, 1], points[i, 2]
        )


@kernel
def unproject_pixels(
    parameters: FloatArray, pixels: FloatArray, bearings: FloatArray, valid: BoolArray
) -> None:
    """`unproject_pixel` for each row of (n, 2)."""
    for i in range(pixels.shape[0]):
        bearings[i, 0], bearings[i, 1], bearings[i, 2], valid[i] = unproject_pixel(
            parameters, pixels[i, 0], pixels[i, 1]
        )
