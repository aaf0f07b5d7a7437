"""The equirectangular panorama: longitude and latitude as pixel coordinates."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any, ClassVar

import numpy as np

from omniservo.cameras.kernel_camera import Kernels
from omniservo.cameras.models.lens_model import Domain, LensModel
from omniservo.cameras.models.sphere_kernels import project_equirectangular, unproject_equirectangular
from omniservo.geometry.arrays import FloatArray


@dataclass(frozen=True, repr=False)
class Equirectangular(LensModel):
    """u = W(λ/2π + ½) − ½ with λ = atan2(X, Z), v = H(φ/π + ½) − ½ with φ = atan2(Y, ‖(X, Z)‖).

    Longitude λ grows to the right, latitude φ downwards; the axis z is in the middle of the image.

    **Domain.** All directions but the two poles; the seam straight behind belongs to the left border, so that
    the last 10⁻¹² of the width before the right one is left out. Narrowed to ``max_angle``.

    Args:
        width, height: image size [px].
        max_angle, dead_zone, mask: see `LensModel`.

    Raises:
        InputError: a number is not finite or not legal.
    """

    width: int
    height: int

    model: ClassVar[str] = "equirectangular"
    kernels: ClassVar[Kernels] = (project_equirectangular, unproject_equirectangular)

    @property
    def warnings(self) -> tuple[str, ...]:
        """None: the seam and the poles, the image's border, are all that is left out."""
        return ()

    def _checked(self) -> dict[str, Any]:
        return {}

    def _affine(self) -> tuple[FloatArray, tuple[float, float]]:
        return np.eye(2), (0.0, 0.0)

    def _domain(self, most: float) -> Domain:
        return Domain(most, math.inf, np.array([self.width, self.height], dtype=np.float64))
