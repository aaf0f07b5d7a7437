"""The Kannala–Brandt model: the radius is an odd polynomial of the angle."""

from __future__ import annotations

import math
from dataclasses import KW_ONLY, dataclass
from typing import Any, ClassVar

import numpy as np

from omniservo.cameras.camera_fields import numbers, pixel_number
from omniservo.cameras.kernel_camera import Kernels
from omniservo.cameras.models.lens_model import Domain, FocalModel
from omniservo.cameras.models.polynomial_domain import first_positive_root, inverse_table
from omniservo.cameras.models.radial_kernels import TABLE, project_kannala_brandt, unproject_kannala_brandt
from omniservo.geometry.arrays import FloatArray

_SHORT_OF_THE_FOLD = 1.0 - 1e-6
_LARGEST_ANGLE = math.pi * (1.0 - 1e-9)
"""straight behind is a circle in the image, not a point"""


@dataclass(frozen=True, repr=False)
class KannalaBrandt(FocalModel):
    """Kannala and Brandt 2006, four coefficients; OpenCV ``fisheye``, Kalibr ``equidistant``, Basalt ``kb4``.

    r = θ(1 + k1θ² + k2θ⁴ + k3θ⁶ + k4θ⁸), m = r (X, Y)/‖(X, Y)‖, (u, v, 1) = K (m, 1); θ is the angle from
    the axis. CamOdoCal's k2 … k5 are our k1 … k4.

    **Domain.** θ up to a millionth before the first root of dr/dθ, at most π, at most ``max_angle``.

    Args:
        fx, fy, cx, cy, skew: K [px]; focal lengths not 0, of either sign.
        width, height: image size [px].
        k: (k1, k2, k3, k4).
        max_angle, dead_zone, mask: see `LensModel`.

    Raises:
        InputError: a number is not finite or not legal.
    """

    width: int
    height: int
    _: KW_ONLY
    k: tuple[float, float, float, float]
    skew: float = 0.0

    model: ClassVar[str] = "kannala_brandt"
    kernels: ClassVar[Kernels] = (project_kannala_brandt, unproject_kannala_brandt)

    def _checked(self) -> dict[str, Any]:
        k = numbers("k", self.k, (4,), "four numbers [k1, k2, k3, k4]", 1e6)
        return {**self._focal(), "k": k, "skew": pixel_number("skew", self.skew)}

    def _domain(self, most: float) -> Domain:
        slope = [(2 * i + 1) * c for i, c in enumerate((1.0, *self.k))]
        fold = math.sqrt(first_positive_root(slope)) * _SHORT_OF_THE_FOLD
        angle = min(most, fold, _LARGEST_ANGLE)

        def radius(theta: FloatArray) -> FloatArray:
            t = theta * theta
            return np.asarray(theta * np.polynomial.polynomial.polyval(t, [1.0, *self.k]))

        end = float(radius(np.array(angle)))
        table = inverse_table(radius, angle, TABLE)
        nodes = table[: TABLE + 1]
        head = np.array([angle, TABLE / end, *self.k])
        return Domain(angle, end, np.concatenate([head, table, np.sin(nodes), np.cos(nodes)]))
