"""Projecting and unprojecting many points with any model: one loop a direction over the model's number."""

import math

from omniservo.cameras.models.pinhole_kernels import pinhole_bearing, pinhole_plane
from omniservo.cameras.models.radial_kernels import (
    kannala_brandt_bearing,
    kannala_brandt_plane,
    ocam_bearing,
    ocam_plane,
)
from omniservo.cameras.models.sphere_kernels import (
    double_sphere_bearing,
    double_sphere_plane,
    equirectangular_bearing,
    equirectangular_pixel,
    extended_bearing,
    extended_plane,
)
from omniservo.geometry.arrays import BoolArray, FloatArray
from omniservo.geometry.kernel import kernel

KANNALA_BRANDT, EXTENDED, DOUBLE_SPHERE, OCAM, PINHOLE, EQUIRECTANGULAR = range(6)

_LEAST_SQUARE = 1e-280
_LARGEST_SQUARE = 1e280
_INWARDS = 6e-14
"""on ‖m‖²: what is unprojected lies so far inside the largest that is projected"""


@kernel
def project_points(
    model: int, p: FloatArray, points: FloatArray, pixels: FloatArray, valid: BoolArray
) -> None:
    """Project each row of ``points`` (n, 3) into ``pixels`` (n, 2) and ``valid`` (n,)."""
    for i in range(points.shape[0]):
        x, y, z = points[i, 0], points[i, 1], points[i, 2]
        square = x * x + y * y + z * z
        rho = math.sqrt(square)
        mx, my, ok = math.nan, math.nan, False
        if _LEAST_SQUARE < square < _LARGEST_SQUARE and z > p[10] * rho:
            if model == KANNALA_BRANDT:
                mx, my, ok = kannala_brandt_plane(p, x, y, z)
            elif model == EXTENDED:
                mx, my, ok = extended_plane(p, x, y, z)
            elif model == DOUBLE_SPHERE:
                mx, my, ok = double_sphere_plane(p, x, y, z, rho)
            elif model == OCAM:
                mx, my, ok = ocam_plane(p, x, y, z, rho)
            elif model == PINHOLE:
                mx, my, ok = pinhole_plane(p, x, y, z)
            else:
                mx, my, ok = equirectangular_pixel(p, x, y, z)
            ok = ok and mx * mx + my * my <= p[11]
        valid[i] = ok
        pixels[i, 0] = p[0] * mx + p[1] * my + p[4] if ok else math.nan
        pixels[i, 1] = p[2] * mx + p[3] * my + p[5] if ok else math.nan


@kernel
def unproject_pixels(
    model: int, p: FloatArray, pixels: FloatArray, bearings: FloatArray, valid: BoolArray
) -> None:
    """Unproject each row of ``pixels`` (n, 2) into ``bearings`` (n, 3) and ``valid`` (n,)."""
    inner = p[11] * (1.0 - _INWARDS)
    for i in range(pixels.shape[0]):
        u, v = pixels[i, 0] - p[4], pixels[i, 1] - p[5]
        mx, my = p[6] * u + p[7] * v, p[8] * u + p[9] * v
        x, y, z, ok = math.nan, math.nan, math.nan, False
        square = mx * mx + my * my
        if square <= p[12]:
            if square > inner:  # rounding beyond the rim: back to it
                shrink = math.sqrt(inner / square)
                mx, my = shrink * mx, shrink * my
            if model == KANNALA_BRANDT:
                x, y, z, ok = kannala_brandt_bearing(p, mx, my)
            elif model == EXTENDED:
                x, y, z, ok = extended_bearing(p, mx, my)
            elif model == DOUBLE_SPHERE:
                x, y, z, ok = double_sphere_bearing(p, mx, my)
            elif model == OCAM:
                x, y, z, ok = ocam_bearing(p, mx, my)
            elif model == PINHOLE:
                x, y, z, ok = pinhole_bearing(p, mx, my)
            else:
                x, y, z, ok = equirectangular_bearing(p, mx, my)
                ok = ok and z > p[10] - 1e-15
        valid[i] = ok
        bearings[i, 0] = x if ok else math.nan
        bearings[i, 1] = y if ok else math.nan
        bearings[i, 2] = max(z, p[10] + 1e-15) if ok else math.nan
