"""The OCam model: the ray's height over the sensor is a polynomial of the radius."""

from __future__ import annotations

import math
from dataclasses import KW_ONLY, dataclass
from typing import Any, ClassVar

import numpy as np
from numpy.polynomial.polynomial import polyval

from omniservo.cameras.camera_fields import numbers, pixel_number
from omniservo.cameras.kernel_camera import Kernels
from omniservo.cameras.models.lens_model import Domain, LensModel
from omniservo.cameras.models.polynomial_domain import first_positive_root, inverse_table
from omniservo.cameras.models.radial_kernels import TABLE, project_ocam, unproject_ocam
from omniservo.errors import InputError
from omniservo.geometry.arrays import FloatArray

_MOST_COEFFICIENTS = 20
_SHORT_OF_THE_FOLD = 1.0 - 1e-4
"""of ρ: at the fold a pixel follows from a ray with an infinite derivative, here with 10⁻¹⁰ px"""
_LARGEST_ANGLE = math.pi * (1.0 - 1e-9)
_LARGEST_RADIUS = 1e6
"""[px]"""


@dataclass(frozen=True, repr=False)
class OcamPolynomial(LensModel):
    """Scaramuzza, Martinelli, Siegwart 2006, OCamCalib's model in our axes.

    A pixel (u, v) = [[1, e], [d, c]](x, y) + (cx, cy) sees along (x, y, −(a0 + a1ρ + a2ρ² + …)), ρ = ‖(x, y)‖
    [px]. OCamCalib's own files count rows first and from 1; its z axis is our −z.

    **Domain.** The angle θ(ρ) grows while −a0 + a2ρ² + 2a3ρ³ + 3a4ρ⁴ + … > 0: up to 0.01% before its first
    root. Narrowed to ``max_angle``.

    Args:
        coefficients: (a0, a1, a2, …), 1 to 20 numbers, a0 < 0; a_i [px^(1−i)].
        cx, cy: the centre [px].
        width, height: image size [px].
        stretch: (c, d, e), c − d e not 0.
        max_angle, dead_zone, mask: see `LensModel`.

    Raises:
        InputError: a number is not finite or not legal.
    """

    coefficients: tuple[float, ...]
    cx: float
    cy: float
    width: int
    height: int
    _: KW_ONLY
    stretch: tuple[float, float, float] = (1.0, 0.0, 0.0)

    model: ClassVar[str] = "ocam"
    kernels: ClassVar[Kernels] = (project_ocam, unproject_ocam)

    def _checked(self) -> dict[str, Any]:
        counts = range(1, _MOST_COEFFICIENTS + 1)
        a = numbers("coefficients", self.coefficients, counts, "1 to 20 numbers [a0, a1, …]", 1e9)
        if a[0] > -1e-6:
            raise InputError(f"coefficients: a0 = {a[0]:g} given; legal: below 0 (the axis looks along +z)")
        c, d, e = numbers("stretch", self.stretch, (3,), "three numbers [c, d, e]", 1e3)
        if abs(c - d * e) < 1e-3:
            raise InputError(f"stretch: c - d e = {c - d * e:g} given; legal: at least 0.001 in size")
        centre = {"cx": pixel_number("cx", self.cx), "cy": pixel_number("cy", self.cy)}
        return {**centre, "coefficients": a, "stretch": (c, d, e)}

    def _affine(self) -> tuple[FloatArray, tuple[float, float]]:
        c, d, e = self.stretch
        return np.array([[1.0, e], [d, c]]), (self.cx, self.cy)

    def _domain(self, most: float) -> Domain:
        a = np.array(self.coefficients)
        # θ grows where ρ f′ − f > 0
        fold = first_positive_root([-a[0], 0.0, *(k * a[k + 1] for k in range(1, len(a) - 1))])
        end = min(fold * _SHORT_OF_THE_FOLD, _LARGEST_RADIUS)

        def angle(rho: FloatArray) -> FloatArray:
            return np.asarray(np.arctan2(rho, -polyval(rho, a)))

        limit = min(most, _LARGEST_ANGLE)
        if angle(np.array(end)) > limit:
            low, high = 0.0, end
            for _ in range(200):
                half = 0.5 * (low + high)
                low, high = (half, high) if angle(np.array(half)) < limit else (low, half)
            end = low
        else:
            limit = float(angle(np.array(end)))
        table = inverse_table(lambda rho: np.asarray(np.sin(0.5 * angle(rho))), end, TABLE)
        head = [len(a), TABLE / math.sin(0.5 * float(angle(np.array(end)))), 0.0, 0.0, 0.0]
        return Domain(limit, end, np.concatenate([head, a, table]))
