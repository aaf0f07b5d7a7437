"""The extended unified model: a quadric instead of the unified model's sphere."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any, ClassVar

import numpy as np

from omniservo.cameras.kernel_camera import Kernels
from omniservo.cameras.models.lens_model import Domain, FocalModel
from omniservo.cameras.models.sphere_kernels import project_extended, unproject_extended
from omniservo.geometry.arrays import finite_number


@dataclass(frozen=True, repr=False)
class ExtendedUnified(FocalModel):
    """Khomutenko, Garcia, Martinet 2016; Kalibr and Basalt ``eucm``.

    d = √(β(X² + Y²) + Z²), m = (X, Y)/(αd + (1−α)Z), (u, v) = (fx m_x + cx, fy m_y + cy). With β = 1 it
    is the unified model: α = ξ/(1+ξ), focal lengths divided by 1 + ξ.

    **Domain.** Z > −w d with w = α/(1−α) for α ≤ ½ and (1−α)/α above; a pixel has to have
    ‖m‖² ≤ 1/(β(2α−1)) where α > ½. Narrowed to ``max_angle``.

    Args:
        fx, fy, cx, cy: [px]; focal lengths not 0, of either sign.
        alpha: α in [0, 1].
        beta: β in [10⁻⁶, 10⁶].
        width, height: image size [px].
        max_angle, dead_zone, mask: see `LensModel`.

    Raises:
        InputError: a number is not finite or not legal.
    """

    alpha: float
    beta: float
    width: int
    height: int

    model: ClassVar[str] = "eucm"
    kernels: ClassVar[Kernels] = (project_extended, unproject_extended)

    def _checked(self) -> dict[str, Any]:
        alpha = finite_number("alpha", self.alpha, minimum=0.0, maximum=1.0)
        return {
            **self._focal(),
            "alpha": alpha,
            "beta": finite_number("beta", self.beta, minimum=1e-6, maximum=1e6),
        }

    def _domain(self, most: float) -> Domain:
        alpha, beta = self.alpha, self.beta
        own = np.array([alpha, beta])
        w = alpha / (1.0 - alpha) if alpha <= 0.5 else (1.0 - alpha) / alpha
        angle = math.atan2(math.sqrt((1.0 - w) * (1.0 + w)), -w * math.sqrt(beta))
        if most >= angle:
            return Domain(
                angle, math.inf if alpha <= 0.5 else 1.0 / math.sqrt(beta * (2.0 * alpha - 1.0)), own
            )
        sine, cosine = math.sin(most), math.cos(most)
        below = alpha * math.sqrt(beta * sine * sine + cosine * cosine) + (1.0 - alpha) * cosine
        return Domain(
            most, sine / below if below > 0.0 else math.inf, own
        )  # 0 by rounding, at the model's end
