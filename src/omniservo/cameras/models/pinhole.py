"""The perspective model with every distortion that OpenCV knows."""

from __future__ import annotations

import math
from dataclasses import KW_ONLY, dataclass
from typing import Any, ClassVar

import numpy as np

from omniservo.cameras.camera_fields import numbers, pixel_number
from omniservo.cameras.kernel_camera import Kernels
from omniservo.cameras.models.lens_model import Domain, FocalModel
from omniservo.cameras.models.pinhole_domain import largest_disc, largest_reach, radial_table, tilt_matrix
from omniservo.cameras.models.pinhole_kernels import project_pinhole, unproject_pinhole
from omniservo.errors import InputError

_COUNTS = (0, 4, 5, 8, 12, 14)


@dataclass(frozen=True, repr=False)
class Pinhole(FocalModel):
    """OpenCV's pinhole camera: (u, v, 1) = K (T D(X/Z, Y/Z), 1).

    With r = ‖m‖, D(m) = m (1 + k1r² + k2r⁴ + k3r⁶)/(1 + k4r² + k5r⁴ + k6r⁶) + 2(q·m) m + r² q
    + (s1r² + s2r⁴, s3r² + s4r⁴), q = (p2, p1); T is the homography of a sensor tilted by (τx, τy):
    OpenCV's ``projectPoints``. ``plumb_bob`` is five numbers, ``rational_polynomial`` eight.

    **Domain.** Z > 0 and m in the largest disc on which the symmetric part of D's Jacobian is positive
    definite (there D is one-to-one), a millionth before its end, and in front of the tilted sensor.
    Narrowed to ``max_angle``.

    Args:
        fx, fy, cx, cy, skew: K [px]; focal lengths not 0, of either sign.
        width, height: image size [px].
        distortion: (k1, k2, p1, p2[, k3[, k4, k5, k6[, s1, s2, s3, s4[, τx, τy]]]]): 0, 4, 5, 8, 12 or 14
            numbers; τ [rad], below 1 in size.
        max_angle, dead_zone, mask: see `LensModel`.

    Raises:
        InputError: a number is not finite or not legal.
    """

    width: int
    height: int
    _: KW_ONLY
    distortion: tuple[float, ...] = ()
    skew: float = 0.0

    model: ClassVar[str] = "pinhole"
    kernels: ClassVar[Kernels] = (project_pinhole, unproject_pinhole)

    def _checked(self) -> dict[str, Any]:
        legal = "0, 4, 5, 8, 12 or 14 numbers in OpenCV's order"
        distortion = numbers("distortion", self.distortion, _COUNTS, legal, 1e6)
        if any(abs(tilt) >= 1.0 for tilt in distortion[12:]):
            raise InputError(f"distortion: tilt {list(distortion[12:])} given; legal: below 1 rad in size")
        return {**self._focal(), "distortion": distortion, "skew": pixel_number("skew", self.skew)}

    def _domain(self, most: float) -> Domain:
        coefficients = np.zeros(14)
        coefficients[: len(self.distortion)] = self.distortion
        tilt = tilt_matrix(*coefficients[12:])
        distorted, tilted = any(coefficients[:12]), any(coefficients[12:])
        disc = largest_disc(tuple(coefficients.tolist()), tuple((tilt[2] / tilt[2, 2]).tolist()))
        if most < math.pi / 2:
            disc = min(disc, math.tan(most))
        angle = min(most, math.atan(disc))
        square = min(disc * disc, 1e280)
        kind = 2.0 if tilted else 1.0 if distorted else 0.0
        reach = largest_reach(coefficients, disc) if kind else disc
        table, step = radial_table(coefficients, disc, self._farthest()) if kind else (np.zeros(0), 0.0)
        head = [square, step, min(reach * reach, 1e280), kind, *coefficients]
        own = np.concatenate([head, tilt.ravel(), np.linalg.inv(tilt).ravel(), table])
        return Domain(angle, math.inf, own)

    def _farthest(self) -> float:
        """Return ‖T D(m)‖ at the farthest corner of the image."""
        u, v = np.meshgrid([-0.5, self.width - 0.5], [-0.5, self.height - 0.5])
        y = (v - self.cy) / self.fy
        return float(np.hypot((u - self.cx - self.skew * y) / self.fx, y).max())
