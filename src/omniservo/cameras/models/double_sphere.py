"""The double sphere model: onto a sphere, then through a unified model whose sphere is shifted by ξ."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any, ClassVar

import numpy as np

from omniservo.cameras.kernel_camera import Kernels
from omniservo.cameras.models.lens_model import Domain, FocalModel
from omniservo.cameras.models.sphere_kernels import project_double_sphere, unproject_double_sphere
from omniservo.geometry.arrays import finite_number


@dataclass(frozen=True, repr=False)
class DoubleSphere(FocalModel):
    """Usenko, Demmel, Cremers 2018; Kalibr and Basalt ``ds``.

    Z′ = Z + ξρ, d = ‖(X, Y, Z′)‖, m = (X, Y)/(αd + (1−α)Z′), (u, v) = (fx m_x + cx, fy m_y + cy). With
    ξ = 0 it is the unified model as `ExtendedUnified` with β = 1 is; with α = 0 it is the unified model
    with the same ξ and focal lengths.

    **Domain.** Seen from the shifted centre the angle φ = atan2(‖(X, Y)‖, Z′) is below acos(−w) with
    w = α/(1−α) for α ≤ ½ and (1−α)/α above; that is Z > −(w + ξ)/√(2wξ + ξ² + 1) ρ. For ξ ≥ 1 φ itself
    grows only while Z > −ρ/ξ. Narrowed to ``max_angle``.

    Args:
        fx, fy, cx, cy: [px]; focal lengths not 0, of either sign.
        xi: ξ > −1, at most 10⁶.
        alpha: α in [0, 1].
        width, height: image size [px].
        max_angle, dead_zone, mask: see `LensModel`.

    Raises:
        InputError: a number is not finite or not legal.
    """

    xi: float
    alpha: float
    width: int
    height: int

    model: ClassVar[str] = "double_sphere"
    kernels: ClassVar[Kernels] = (project_double_sphere, unproject_double_sphere)

    def _checked(self) -> dict[str, Any]:
        xi = finite_number("xi", self.xi, above=-1.0, maximum=1e6)
        return {
            **self._focal(),
            "xi": xi,
            "alpha": finite_number("alpha", self.alpha, minimum=0.0, maximum=1.0),
        }

    def _domain(self, most: float) -> Domain:
        xi, alpha = self.xi, self.alpha
        own = np.array([alpha, xi])
        w = alpha / (1.0 - alpha) if alpha <= 0.5 else (1.0 - alpha) / alpha
        end = math.acos(-w)
        folds = xi >= 1.0
        angle = math.acos(-1.0 / xi) if folds else end + math.asin(max(-1.0, min(1.0, xi * math.sin(end))))
        if most >= angle and not folds:
            return Domain(angle, math.inf if alpha <= 0.5 else 1.0 / math.sqrt(2.0 * alpha - 1.0), own)
        angle = min(most, angle)
        shifted = math.cos(angle) + xi
        below = alpha * math.hypot(math.sin(angle), shifted) + (1.0 - alpha) * shifted
        return Domain(angle, math.sin(angle) / below if below > 0.0 else math.inf, own)  # 0 by rounding
