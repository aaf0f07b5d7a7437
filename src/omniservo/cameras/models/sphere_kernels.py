"""Extended unified, double sphere and equirectangular, one point at a time; all in closed form.

Every function takes a lens's ``parameters``; `plane_kernels` names the places that all models share.
"""

import math

from omniservo.cameras.models.arc_tangent import arc_tangent
from omniservo.cameras.models.block_kernels import project_blocks, unproject_each
from omniservo.cameras.models.plane_kernels import COSINE, OWN, distance_in_domain, write_pixel
from omniservo.geometry.arrays import BoolArray, FloatArray
from omniservo.geometry.kernel import kernel, leaf

ALPHA, BETA = range(OWN, OWN + 2)
"""the places of the extended unified model's own parameters; α is the double sphere's, too"""

XI = OWN + 1
"""of the double sphere's ξ"""

WIDTH, HEIGHT = range(OWN, OWN + 2)
"""of the equirectangular panorama's size [px]"""

_RIM = 1e-12
"""how much of the image is left out at the seam and the poles, where a direction has several pixels"""


@leaf
def _height(alpha: float, s: float) -> float:
    """Return m_z = (1 − α²s)/(α√(1 − (2α−1)s) + 1 − α); for large α in the form without 0/0 at the rim."""
    root = math.sqrt(max(0.0, 1.0 - (2.0 * alpha - 1.0) * s))
    if alpha > 0.75:
        return (alpha * root - (1.0 - alpha)) / (2.0 * alpha - 1.0)
    return (1.0 - alpha * alpha * s) / (alpha * root + 1.0 - alpha)


@leaf
def _extended_plane(p: FloatArray, x: float, y: float, z: float) -> tuple[float, float, bool]:
    """Return m = (X, Y)/(αd + (1−α)Z) with d = √(β(X² + Y²) + Z²)."""
    d = math.sqrt(p[BETA] * (x * x + y * y) + z * z)
    denominator = p[ALPHA] * d + (1.0 - p[ALPHA]) * z
    return x / denominator, y / denominator, denominator > 0.0


@leaf
def _extended_bearing(p: FloatArray, mx: float, my: float) -> tuple[float, float, float, bool]:
    """Return the unit vector along (m, (1 − βα²r²)/(α√(1 − (2α−1)βr²) + 1 − α))."""
    z = _height(p[ALPHA], p[BETA] * (mx * mx + my * my))
    scale = 1.0 / math.sqrt(mx * mx + my * my + z * z)
    return scale * mx, scale * my, scale * z, True


@leaf
def _double_sphere_plane(
    p: FloatArray, x: float, y: float, z: float, rho: float
) -> tuple[float, float, bool]:
    """Return m = (X, Y)/(αd + (1−α)Z′) with Z′ = Z + ξρ and d = ‖(X, Y, Z′)‖."""
    shifted = z + p[XI] * rho
    d = math.sqrt(x * x + y * y + shifted * shifted)
    denominator = p[ALPHA] * d + (1.0 - p[ALPHA]) * shifted
    return x / denominator, y / denominator, denominator > 0.0


@leaf
def _double_sphere_bearing(p: FloatArray, mx: float, my: float) -> tuple[float, float, float, bool]:
    """Return η(m, m_z) − (0, 0, ξ): m_z from the inner sphere, η to the outer."""
    alpha, xi, s = p[ALPHA], p[XI], mx * mx + my * my
    mz = _height(alpha, s)
    radicand = max(0.0, mz * mz + (1.0 - xi) * (1.0 + xi) * s)
    eta = (mz * xi + math.sqrt(radicand)) / (mz * mz + s)
    return eta * mx, eta * my, eta * mz - xi, True


@leaf
def _equirectangular_plane(p: FloatArray, x: FloatArray, y: FloatArray, z: FloatArray) -> None:
    """Replace points by u = W(λ/2π + ½) − ½, v = H(φ/π + ½) − ½; x is NaN at the poles.

    λ = atan2(X, Z), φ = atan2(Y, ‖(X, Z)‖).
    """
    width, height = p[WIDTH], p[HEIGHT]
    for i in range(x.shape[0]):
        down = arc_tangent(y[i], math.sqrt(x[i] * x[i] + z[i] * z[i])) / math.pi + 0.5
        across = arc_tangent(x[i], z[i]) / (2.0 * math.pi) + 0.5
        across = (
            0.0 if across >= 1.0 - _RIM else across
        )  # the seam, straight behind, belongs to the left border
        u, y[i] = across * width - 0.5, down * height - 0.5
        x[i] = u if (down >= _RIM) & (down <= 1.0 - _RIM) else math.nan


@leaf
def _equirectangular_bearing(p: FloatArray, u: float, v: float) -> tuple[float, float, float, bool]:
    """Return (cos φ sin λ, sin φ, cos φ cos λ)."""
    across, down = (u + 0.5) / p[WIDTH], (v + 0.5) / p[HEIGHT]
    if not (-1e-14 <= across < 1.0 - _RIM and _RIM * 0.99 <= down <= 1.0 - _RIM * 0.99):
        return math.nan, math.nan, math.nan, False
    longitude, latitude = 2.0 * math.pi * (max(across, 0.0) - 0.5), math.pi * (down - 0.5)
    level = math.cos(latitude)
    z = level * math.cos(longitude)
    return level * math.sin(longitude), math.sin(latitude), z, z > p[COSINE] - 1e-15


@leaf
def project_extended(p: FloatArray, points: FloatArray, pixels: FloatArray, valid: BoolArray) -> None:
    """Project each row of ``points`` (n, 3) into ``pixels`` (n, 2) and ``valid`` (n,)."""
    for i in range(points.shape[0]):
        x, y, z = points[i, 0], points[i, 1], points[i, 2]
        _, ok = distance_in_domain(p, x, y, z)
        mx, my = math.nan, math.nan
        if ok:
            mx, my, ok = _extended_plane(p, x, y, z)
        write_pixel(p, mx, my, ok, i, pixels, valid)


@leaf
def unproject_extended(p: FloatArray, pixels: FloatArray, bearings: FloatArray, valid: BoolArray) -> None:
    """Unproject each row of ``pixels`` (n, 2) into ``bearings`` (n, 3) and ``valid`` (n,)."""
    unproject_each(_extended_bearing, p, pixels, bearings, valid)


@leaf
def project_double_sphere(p: FloatArray, points: FloatArray, pixels: FloatArray, valid: BoolArray) -> None:
    """Project each row of ``points`` (n, 3) into ``pixels`` (n, 2) and ``valid`` (n,)."""
    for i in range(points.shape[0]):
        x, y, z = points[i, 0], points[i, 1], points[i, 2]
        rho, ok = distance_in_domain(p, x, y, z)
        mx, my = math.nan, math.nan
        if ok:
            mx, my, ok = _double_sphere_plane(p, x, y, z, rho)
        write_pixel(p, mx, my, ok, i, pixels, valid)


@leaf
def unproject_double_sphere(
    p: FloatArray, pixels: FloatArray, bearings: FloatArray, valid: BoolArray
) -> None:
    """Unproject each row of ``pixels`` (n, 2) into ``bearings`` (n, 3) and ``valid`` (n,)."""
    unproject_each(_double_sphere_bearing, p, pixels, bearings, valid)


@kernel
def project_equirectangular(p: FloatArray, points: FloatArray, pixels: FloatArray, valid: BoolArray) -> None:
    """Project each row of ``points`` (n, 3) into ``pixels`` (n, 2) and ``valid`` (n,)."""
    project_blocks(_equirectangular_plane, p, points, pixels, valid)


@leaf
def unproject_equirectangular(
    p: FloatArray, pixels: FloatArray, bearings: FloatArray, valid: BoolArray
) -> None:
    """Unproject each row of ``pixels`` (n, 2) into ``bearings`` (n, 3) and ``valid`` (n,)."""
    unproject_each(_equirectangular_bearing, p, pixels, bearings, valid)
