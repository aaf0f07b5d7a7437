"""The unified camera in the parameters in which it is adjusted, with derivatives.

θ = (gx, gy, cx, cy, α, κ1, κ2, π1, π2), the same family as fx, fy, cx, cy, ξ, k1, k2, p1, p2 through

    α = ξ/(1+ξ),  g = f/(1+ξ),  κ1 = k1/(1+ξ)²,  κ2 = k2/(1+ξ)⁴,  π = p/(1+ξ):
    n = (X, Y)/(αρ + (1−α)Z),  pixel = g D(n) + c.

g is the pixels per radian on the axis, which corners determine well; ξ and f only together. α is bounded
where ξ is not: 0 perspective, ½ parabolic mirror, above ½ fisheye (Khomutenko, Garcia, Martinet 2016, with
β = 1).
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from omniservo.cameras import UnifiedCamera
from omniservo.geometry.arrays import BoolArray, FloatArray

NAMES = ("fx", "fy", "cx", "cy", "xi", "k1", "k2", "p1", "p2")
GX, GY, CX, CY, ALPHA, K1, K2, P1, P2 = range(9)
"""The places of θ: g and c [px], and what has no unit"""

RADIAL = slice(K1, P1)
"""the places of (κ1, κ2)"""

PLAIN = np.arange(9) < 5
"""(9,) bool: what the plain model lets free; the radial-tangential one frees all"""

LARGEST_ALPHA = 0.9
"""ξ = 9: no lens is known beyond 3, and k2 grows with (1+ξ)⁴"""

_LARGEST_COEFFICIENT = 5e5
"""of k1, k2, p1, p2: half of what a camera may have"""

_LEAST_DENOMINATOR = 1e-4
"""αρ + (1−α)Z over ρ: closer to 0 a point is far outside any image"""


def to_physical(theta: FloatArray) -> FloatArray:
    """Return (fx, fy, cx, cy, ξ, k1, k2, p1, p2) of θ (9,)."""
    s = 1.0 - theta[ALPHA]
    gx, gy, cx, cy, alpha, k1, k2, p1, p2 = theta
    return np.array([gx / s, gy / s, cx, cy, alpha / s, k1 / s**2, k2 / s**4, p1 / s, p2 / s])


def from_physical(values: Sequence[float] | FloatArray) -> FloatArray:
    """Return θ (9,) of (fx, fy, cx, cy, ξ, k1, k2, p1, p2)."""
    fx, fy, cx, cy, xi, k1, k2, p1, p2 = values
    s = 1.0 / (1.0 + xi)
    return np.array([fx * s, fy * s, cx, cy, xi * s, k1 * s**2, k2 * s**4, p1 * s, p2 * s])


def is_legal(theta: FloatArray) -> bool:
    """Return whether there is a camera of θ: its distortion is finite and not absurd."""
    return bool(np.abs(to_physical(theta)[5:]).max() <= _LARGEST_COEFFICIENT)


def physical_jacobian(theta: FloatArray) -> FloatArray:
    """Return ∂(fx, fy, cx, cy, ξ, k1, k2, p1, p2)/∂θ (9, 9)."""
    s = 1.0 - theta[ALPHA]
    scale = np.array([1 / s, 1 / s, 1.0, 1.0, 1 / s**2, 1 / s**2, 1 / s**4, 1 / s, 1 / s])
    jacobian = np.diag(scale)
    power = np.array([1, 1, 0, 0, 0, 2, 4, 1, 1])
    jacobian[:, ALPHA] += power * to_physical(theta) / s
    return jacobian


def camera_of(theta: FloatArray, size: tuple[int, int], **lens: Any) -> UnifiedCamera:
    """Return the camera of θ with the image ``size`` [px] and the other fields of a camera."""
    fx, fy, cx, cy, xi, *distortion = (float(x) for x in to_physical(theta))
    return UnifiedCamera(fx, fy, cx, cy, xi, *size, distortion=distortion, **lens)


def project(theta: FloatArray, points: FloatArray) -> tuple[FloatArray, BoolArray]:
    """Return pixels (n, 2) of points (n, 3) in the camera frame, and whether the formula holds (n,)."""
    rho = np.sqrt((points * points).sum(1))
    depth = theta[ALPHA] * rho + (1.0 - theta[ALPHA]) * points[:, 2]
    ok = depth > _LEAST_DENOMINATOR * rho
    depth = np.where(ok, depth, 1.0)
    x, y = points[:, 0] / depth, points[:, 1] / depth
    dx, dy, *_ = _distort(theta, x, y)
    return np.stack([theta[GX] * dx + theta[CX], theta[GY] * dy + theta[CY]], 1), ok


def project_jacobian(
    theta: FloatArray, points: FloatArray
) -> tuple[FloatArray, FloatArray, FloatArray, BoolArray]:
    """Return pixels (n, 2), ∂pixel/∂θ (n, 2, 9), ∂pixel/∂point (n, 2, 3), ok (n,)."""
    x, y, z = points.T
    rho = np.sqrt((points * points).sum(1))
    alpha = theta[ALPHA]
    depth = alpha * rho + (1.0 - alpha) * z
    ok = depth > _LEAST_DENOMINATOR * rho
    inverse = 1.0 / np.where(ok, depth, 1.0)
    slope = (alpha / rho)[:, None] * points  # ∂depth/∂point
    slope[:, 2] += 1.0 - alpha
    nx, ny = x * inverse, y * inverse
    dx, dy, jxx, jxy, jyy = _distort(theta, nx, ny)
    gx, gy = theta[GX], theta[GY]
    pixels = np.stack([gx * dx + theta[CX], gy * dy + theta[CY]], 1)

    r2 = nx * nx + ny * ny
    plane = np.empty((len(x), 2, 2))  # ∂pixel/∂n
    plane[:, 0, 0], plane[:, 0, 1], plane[:, 1, 0], plane[:, 1, 1] = gx * jxx, gx * jxy, gy * jxy, gy * jyy
    along = plane[:, :, 0] * nx[:, None] + plane[:, :, 1] * ny[:, None]
    by_point = -(along * inverse[:, None])[:, :, None] * slope[:, None, :]
    by_point[:, :, :2] += plane * inverse[:, None, None]

    by_theta = np.zeros((len(x), 2, 9))
    by_theta[:, 0, GX], by_theta[:, 1, GY] = dx, dy
    by_theta[:, 0, CX] = by_theta[:, 1, CY] = 1.0
    by_theta[:, :, ALPHA] = -along * ((rho - z) * inverse)[:, None]
    by_theta[:, 0, K1], by_theta[:, 1, K1] = gx * nx * r2, gy * ny * r2
    by_theta[:, 0, K2], by_theta[:, 1, K2] = gx * nx * r2 * r2, gy * ny * r2 * r2
    by_theta[:, 0, P1], by_theta[:, 1, P1] = gx * 2.0 * nx * ny, gy * (r2 + 2.0 * ny * ny)
    by_theta[:, 0, P2], by_theta[:, 1, P2] = gx * (r2 + 2.0 * nx * nx), gy * 2.0 * nx * ny
    return pixels, by_theta, by_point, ok


def unproject_plain(theta: FloatArray, pixels: FloatArray) -> tuple[FloatArray, BoolArray]:
    """Return bearings (n, 3) of pixels without regard to distortion, and whether the plane has them (n,).

    b ∝ (n, (1 − α²r²)/(α√(1 − (2α−1)r²) + 1 − α)).
    """
    alpha = theta[ALPHA]
    plane = (pixels - theta[2:4]) / theta[:2]
    r2 = (plane * plane).sum(1)
    radicand = 1.0 - (2.0 * alpha - 1.0) * r2
    ok = radicand >= 0.0
    z = (1.0 - alpha * alpha * r2) / (alpha * np.sqrt(np.maximum(radicand, 0.0)) + 1.0 - alpha)
    bearings = np.concatenate([plane, z[:, None]], 1)
    return bearings / np.linalg.norm(bearings, axis=1, keepdims=True), ok


def unproject(theta: FloatArray, pixels: FloatArray) -> tuple[FloatArray, BoolArray]:
    """Return bearings (n, 3) of pixels, and whether the camera has them (n,); (0, 0, 1) where it has not."""
    if not theta[5:].any():
        return unproject_plain(theta, pixels)
    bearings, ok = camera_of(theta, (1, 1)).unproject(pixels)
    bearings[~ok] = [0.0, 0.0, 1.0]
    return bearings, ok


def field(theta: FloatArray, size: tuple[int, int], angle: float) -> FloatArray:
    """Return directions (n, 3) up to ``angle`` from the axis [rad] that the image shows, on a polar grid."""
    angles, azimuths = np.linspace(0.0, angle, 22)[1:], np.arange(24) * (np.pi / 12.0)
    a, z = (x.ravel() for x in np.meshgrid(angles, azimuths))
    rays = np.stack([np.sin(a) * np.cos(z), np.sin(a) * np.sin(z), np.cos(a)], 1)
    rays = np.concatenate([[[0.0, 0.0, 1.0]], rays])
    pixels, ok = project(theta, rays)
    inside = ok & ((pixels >= -0.5) & (pixels <= np.array(size) - 0.5)).all(axis=1)
    return np.asarray(rays[inside])


def angles_of(points: FloatArray) -> FloatArray:
    """Return the angles (n,) [rad] of points (n, 3) from the optical axis."""
    return np.asarray(np.arctan2(np.hypot(points[:, 0], points[:, 1]), points[:, 2]))


def ray_errors(theta: FloatArray, points: FloatArray, errors: FloatArray) -> FloatArray:
    """Return the angles (n,) [rad] that pixel errors (n, 2) are at ``points`` (n, 3), to first order."""
    tangents = tangent_axes(points)
    _, _, by_point, _ = project_jacobian(theta, points / np.linalg.norm(points, axis=1, keepdims=True))
    solved = np.linalg.solve(by_point @ tangents, errors[:, :, None])[:, :, 0]
    return np.asarray(np.hypot(solved[:, 0], solved[:, 1]))


def tangent_axes(points: FloatArray) -> FloatArray:
    """Return two unit vectors across each direction (n, 3), as the columns of (n, 3, 2)."""
    b = points / np.linalg.norm(points, axis=1, keepdims=True)
    helper = np.where((np.abs(b[:, 2]) < 0.9)[:, None], [0.0, 0.0, 1.0], [1.0, 0.0, 0.0])
    first = np.cross(helper, b)
    first /= np.linalg.norm(first, axis=1, keepdims=True)
    return np.stack([first, np.cross(b, first)], 2)


def _distort(
    theta: FloatArray, x: FloatArray, y: FloatArray
) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray, FloatArray]:
    """Return D(n) and the symmetric ∂D/∂n as (dx, dy, xx, xy, yy)."""
    k1, k2, p1, p2 = theta[5:]
    r2 = x * x + y * y
    factor = 1.0 + r2 * (k1 + r2 * k2)
    slope = 2.0 * (k1 + 2.0 * k2 * r2)
    tangential = 2.0 * (p2 * x + p1 * y)
    return (
        x * (factor + tangential) + p2 * r2,
        y * (factor + tangential) + p1 * r2,
        factor + slope * x * x + 6.0 * p2 * x + 2.0 * p1 * y,
        slope * x * y + 2.0 * (p1 * x + p2 * y),
        factor + slope * y * y + 2.0 * p2 * x + 6.0 * p1 * y,
    )
