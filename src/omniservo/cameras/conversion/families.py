"""How each class of camera is fitted: its formula on unit rays, its starting values, its numbers.

A family's shape vector holds what is no part of K, in a scale without bounds. ``plane`` maps rays (n, 3) to
the plane m (n, 2) without any check of the domain; pixels are K m.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from itertools import product
from typing import Any

import numpy as np

from omniservo.cameras.models import DoubleSphere, ExtendedUnified, KannalaBrandt, OcamPolynomial, Pinhole
from omniservo.cameras.models.central_model import CentralModel
from omniservo.cameras.unified_camera import UnifiedCamera
from omniservo.errors import InputError
from omniservo.geometry.arrays import FloatArray

_LEAST = 1e-3
"""denominators below this stand for rays that the formula cannot show"""

_NEWTON = 12


@dataclass(frozen=True)
class FitFamily:
    """One way to fit a class of cameras."""

    kind: type[CentralModel]
    starts: tuple[tuple[float, ...], ...]
    """starting shapes; the radial coefficients that ``basis`` finds are put in behind them"""
    basis: Callable[[tuple[float, ...], FloatArray], FloatArray]
    """(start, rays) → (n, j): radius on the plane ≈ Σ c_j basis_j, c_0 the scale of K"""
    size: int
    """numbers of the shape vector, without tangential ones"""
    plane: Callable[[FloatArray, FloatArray], FloatArray]
    """(shape, rays) → m"""
    build: Callable[[FloatArray, FloatArray, dict[str, Any]], CentralModel]
    """(K as fx, fy, cx, cy, skew; shape; the lens's fields) → camera"""
    tangential: bool = False
    """whether two more numbers p1, p2 may follow the shape"""
    skew: bool = True


def _side(rays: FloatArray) -> FloatArray:
    return np.hypot(rays[:, 0], rays[:, 1])


def _angles(rays: FloatArray) -> FloatArray:
    return np.arctan2(_side(rays), rays[:, 2])


def _radtan(m: FloatArray, radial: FloatArray, tangential: FloatArray) -> FloatArray:
    """Return m·radial + 2(q·m) m + r² q, q = (p2, p1)."""
    distorted = m * radial[:, None]
    if len(tangential):
        q = tangential[::-1]
        distorted += 2.0 * (m @ q)[:, None] * m + (m * m).sum(axis=1)[:, None] * q
    return np.asarray(distorted)


def _unified_m(xi: float, rays: FloatArray) -> FloatArray:
    return np.asarray(rays[:, :2] / np.maximum(rays[:, 2] + xi, _LEAST)[:, None])


def _unified_plane(shape: FloatArray, rays: FloatArray) -> FloatArray:
    m = _unified_m(abs(shape[0]), rays)
    r2 = (m * m).sum(axis=1)
    return _radtan(m, 1.0 + r2 * (shape[1] + r2 * shape[2]), shape[3:])


def _plain_plane(shape: FloatArray, rays: FloatArray) -> FloatArray:
    return _unified_m(abs(shape[0]), rays)


def _unified_basis(start: tuple[float, ...], rays: FloatArray) -> FloatArray:
    r = _side(_unified_m(start[0], rays))
    return np.column_stack([r, r**3, r**5])


def _build_unified(K: FloatArray, shape: FloatArray, lens: dict[str, Any]) -> CentralModel:
    k1, k2, p1, p2 = (*shape[1:], 0.0, 0.0, 0.0, 0.0)[:4]
    fx, fy, cx, cy, skew = K
    return UnifiedCamera(fx, fy, cx, cy, abs(shape[0]), skew=skew, distortion=(k1, k2, p1, p2), **lens)


def _build_kannala_brandt(K: FloatArray, shape: FloatArray, lens: dict[str, Any]) -> CentralModel:
    k1, k2, k3, k4 = shape.tolist()
    fx, fy, cx, cy, skew = K.tolist()
    return KannalaBrandt(fx, fy, cx, cy, **lens, k=(k1, k2, k3, k4), skew=skew)


def _kannala_brandt_plane(shape: FloatArray, rays: FloatArray) -> FloatArray:
    theta = _angles(rays)
    r = theta * np.polynomial.polynomial.polyval(theta**2, [1.0, *shape])
    return np.asarray(rays[:, :2] * (r / np.maximum(_side(rays), 1e-300))[:, None])


def _logistic(x: float) -> float:
    return 1.0 / (1.0 + math.exp(-max(-40.0, min(40.0, x))))


def _logit(alpha: float) -> float:
    return math.log(alpha / (1.0 - alpha))


def _extended_plane(shape: FloatArray, rays: FloatArray) -> FloatArray:
    alpha, beta = _logistic(shape[0]), math.exp(min(10.0, shape[1]))
    d = np.sqrt(beta * _side(rays) ** 2 + rays[:, 2] ** 2)
    return np.asarray(rays[:, :2] / np.maximum(alpha * d + (1.0 - alpha) * rays[:, 2], _LEAST)[:, None])


def _build_extended(K: FloatArray, shape: FloatArray, lens: dict[str, Any]) -> CentralModel:
    fx, fy, cx, cy, _ = K.tolist()
    alpha, beta = _logistic(shape[0]), math.exp(min(10.0, shape[1]))
    return ExtendedUnified(fx, fy, cx, cy, alpha=alpha, beta=beta, **lens)


def _double_sphere_plane(shape: FloatArray, rays: FloatArray) -> FloatArray:
    xi, alpha = math.exp(min(10.0, shape[0])) - 1.0, _logistic(shape[1])
    z = rays[:, 2] + xi
    d = np.hypot(_side(rays), z)
    return np.asarray(rays[:, :2] / np.maximum(alpha * d + (1.0 - alpha) * z, _LEAST)[:, None])


def _build_double_sphere(K: FloatArray, shape: FloatArray, lens: dict[str, Any]) -> CentralModel:
    fx, fy, cx, cy, _ = K.tolist()
    xi, alpha = math.exp(min(10.0, shape[0])) - 1.0, _logistic(shape[1])
    return DoubleSphere(fx, fy, cx, cy, xi=xi, alpha=alpha, **lens)


def _pinhole_plane(shape: FloatArray, rays: FloatArray) -> FloatArray:
    """Return D(m) for (k1, k2, k3[, k4, k5, k6]) and what follows, p1 and p2."""
    m = _unified_m(0.0, rays)
    s = (m * m).sum(axis=1)
    count = len(shape) // 3 * 3
    above = 1.0 + s * (shape[0] + s * (shape[1] + s * shape[2]))
    below = 1.0 + s * (shape[3] + s * (shape[4] + s * shape[5])) if count == 6 else np.ones(len(s))
    return _radtan(m, above / np.where(np.abs(below) < _LEAST, _LEAST, below), shape[count:])


def _pinhole_basis(start: tuple[float, ...], rays: FloatArray) -> FloatArray:
    r = _side(_unified_m(0.0, rays))
    return np.column_stack([r, r**3, r**5, r**7])


def _build_pinhole(K: FloatArray, shape: FloatArray, lens: dict[str, Any]) -> CentralModel:
    count = len(shape) // 3 * 3
    p1, p2 = shape[count:] if len(shape) > count else (0.0, 0.0)
    k = shape[:count].tolist()
    fx, fy, cx, cy, skew = K.tolist()
    return Pinhole(fx, fy, cx, cy, **lens, skew=skew, distortion=(k[0], k[1], p1, p2, *k[2:]))


def _ocam_plane(shape: FloatArray, rays: FloatArray) -> FloatArray:
    """Return m with m ∥ (X, Y) and r cos θ = (1 + b2 r² + b3 r³ + …) sin θ, by Newton's method."""
    theta = _angles(rays)
    sine, cosine = np.sin(theta), np.cos(theta)
    height = np.polynomial.Polynomial([1.0, 0.0, *shape])
    slope = height.deriv()
    r = 2.0 * np.tan(np.minimum(theta, 2.8) / 2.0)
    for _ in range(_NEWTON):
        derivative = cosine - slope(r) * sine
        step = (r * cosine - height(r) * sine) / np.where(np.abs(derivative) < 0.05, 0.05, derivative)
        r = np.maximum(r - np.clip(step, -0.5, 0.5), 0.0)
    return np.asarray(rays[:, :2] * (r / np.maximum(_side(rays), 1e-300))[:, None])


def _build_ocam(K: FloatArray, shape: FloatArray, lens: dict[str, Any]) -> CentralModel:
    fx, fy, cx, cy, skew = K
    f = abs(fx)
    a = (-f, 0.0, *(-b * f ** (1 - k) for k, b in enumerate(shape.tolist(), 2)))
    if fx < 0.0:
        raise InputError("fx: below 0; an OCam model's u grows to the right, mirror v instead")
    return OcamPolynomial(a, cx, cy, **lens, stretch=(fy / f, 0.0, skew / f))


def _one(plane: Callable[[FloatArray, FloatArray], FloatArray]) -> Callable[..., FloatArray]:
    """Return the basis of a family without linear coefficients: its radius itself."""

    def basis(start: tuple[float, ...], rays: FloatArray) -> FloatArray:
        return _side(plane(np.array(start), rays))[:, None]

    return basis


def _kannala_brandt_basis(start: tuple[float, ...], rays: FloatArray) -> FloatArray:
    return np.asarray(_angles(rays)[:, None] ** np.arange(1, 10, 2))


_XI = tuple((xi,) for xi in (0.0, 0.1, 0.3, 0.5, 0.7, 0.9, 1.0, 1.2, 1.5, 1.8, 2.2, 2.8, 3.6, 5.0, 8.0))
_EXTENDED = tuple(
    (_logit(a), math.log(b)) for a, b in product((0.1, 0.4, 0.5, 0.6, 0.7, 0.85), (0.5, 0.8, 1.0, 1.3, 2.0))
)
_DOUBLE_SPHERE = tuple(
    (math.log(1.0 + xi), _logit(a)) for xi, a in product((-0.4, -0.2, 0.1, 0.6, 1.0), (0.2, 0.45, 0.6, 0.8))
)
_OCAM = tuple((b,) for b in (-0.3, -0.15, 0.01, 0.15))

FAMILIES = (
    FitFamily(UnifiedCamera, _XI, _unified_basis, 3, _unified_plane, _build_unified, tangential=True),
    FitFamily(UnifiedCamera, _XI, _one(_plain_plane), 1, _plain_plane, _build_unified),
    FitFamily(KannalaBrandt, ((),), _kannala_brandt_basis, 4, _kannala_brandt_plane, _build_kannala_brandt),
    FitFamily(
        ExtendedUnified, _EXTENDED, _one(_extended_plane), 2, _extended_plane, _build_extended, skew=False
    ),
    FitFamily(
        DoubleSphere,
        _DOUBLE_SPHERE,
        _one(_double_sphere_plane),
        2,
        _double_sphere_plane,
        _build_double_sphere,
        skew=False,
    ),
    FitFamily(Pinhole, ((),), _pinhole_basis, 3, _pinhole_plane, _build_pinhole, tangential=True),
    FitFamily(Pinhole, ((),), _pinhole_basis, 6, _pinhole_plane, _build_pinhole, tangential=True),
    FitFamily(OcamPolynomial, _OCAM, _one(_ocam_plane), 5, _ocam_plane, _build_ocam),
)
"""A class may have several; the one that leaves least is taken."""
