"""The equirectangular panorama: longitude and latitude as pixel coordinates."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any, ClassVar

import numpy as np
import numpy.typing as npt

from omniservo.cameras.kernel_camera import Kernels
from omniservo.cameras.models.lens_model import Domain, LensModel
from omniservo.cameras.models.sphere_kernels import project_equirectangular, unproject_equirectangular
from omniservo.geometry.arrays import BoolArray, FloatArray


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

    def project_jacobian(self, points: npt.ArrayLike) -> tuple[FloatArray, FloatArray, BoolArray]:
        """Project points (…, 3) [m] with ∂pixel/∂point, which both sides of the seam have alike.

        Returns:
            pixels (…, 2) [px], jacobian (…, 2, 3) [px/m], valid (…); NaN where not valid.
        """
        pixels, valid = self.project(points)
        x, y, z = np.moveaxis(np.where(valid[..., None], np.asarray(points, np.float64), np.nan), -1, 0)
        level = np.hypot(x, z)
        across = self.width / (2.0 * math.pi) / level**2
        down = self.height / math.pi / (level**2 + y**2)
        du = np.stack([across * z, 0.0 * across, -across * x], axis=-1)
        dv = np.stack([-down * y * x / level, down * level, -down * y * z / level], axis=-1)
        return pixels, np.stack([du, dv], axis=-2), valid

    def _checked(self) -> dict[str, Any]:
        return {}

    def _affine(self) -> tuple[FloatArray, tuple[float, float]]:
        return np.eye(2), (0.0, 0.0)

    def _domain(self, most: float) -> Domain:
        return Domain(most, math.inf, np.array([self.width, self.height], dtype=np.float64))
