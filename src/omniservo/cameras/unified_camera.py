"""The unified camera: every central camera from perspective to fisheye and mirror, with its domain."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, ClassVar

import numpy as np
import numpy.typing as npt

from omniservo.cameras import unified_kernels
from omniservo.cameras.calibration_covariance import CovarianceRows, covariance_from
from omniservo.cameras.camera_fields import (
    checked_fields,
    errors_to_dict,
    focal_length,
    image_size,
    image_to_dict,
    largest_angle,
    numbers,
    pixel_number,
    rows_of,
)
from omniservo.cameras.dead_zone import LARGEST_PX, DeadZone, DeadZoneLike, dead_zone_from
from omniservo.cameras.distortion import largest_distorted_radius, largest_invertible_radius
from omniservo.cameras.image_limits import ImageLimits, image_limits
from omniservo.cameras.image_mask import ImageMask, mask_from
from omniservo.cameras.kernel_camera import KernelCamera, Kernels
from omniservo.cameras.model_domain import cosine_of_radius, model_domain
from omniservo.cameras.model_error import ModelError, model_error_from
from omniservo.errors import InputError
from omniservo.field_docs import with_field_docs
from omniservo.geometry.arrays import BoolArray, FloatArray, finite_number, frozen, frozen_again

_LARGEST_XI = 1e6
_ANGLE_SLACK = 1e-15
"""on the cosine of max_angle: a point at that angle is inside, whatever the rounding"""

_RADIUS_SLACK = 1e-13
"""on r²: the rounded pixel of a valid point can be unprojected"""

_REQUIRED = ("fx", "fy", "cx", "cy", "xi", "width", "height")
_OPTIONAL = (
    "skew", "distortion", "max_angle", "dead_zone", "mask", "deviation_px", "model_error",
    "calibration_covariance",
)  # fmt: skip


@with_field_docs
@dataclass(frozen=True, init=False, repr=False)
class UnifiedCamera(KernelCamera):
    """The unified model (2): m = (X, Y)/(Z + ξρ), p = K D(m), with ρ = ‖(X, Y, Z)‖.

    D is radial-tangential distortion, D(m) = (1 + k1 r² + k2 r⁴) m + 2(q·m) m + r² q with r = ‖m‖ and
    q = (p2, p1), as in Mei's toolbox, OpenCV ``omnidir``, Kalibr ``omni-radtan`` and CamOdoCal ``MEI``.
    ξ = 0 is a perspective camera, 0 < ξ < 1 a hyperbolic and ξ = 1 a parabolic mirror, ξ > 1 a fisheye.

    **Domain.** A point can be projected where Z > −ξρ (ξ ≤ 1) or Z > −ρ/ξ (ξ > 1); a pixel can be
    unprojected, for ξ > 1, where r² ≤ 1/(ξ²−1). Both are narrowed to ``max_angle`` and to the largest disc
    ‖m‖ ≤ r in which D is one-to-one. Inside, `project` and `unproject` are inverse to each other.
    `usable_angle` says how far from the axis that is.

    Values are equal when all their numbers are; they can be keys of a dict.

    Args:
        fx, fy: focal lengths [px], not 0. One may be negative: a mirror reflects the world.
        cx, cy: principal point [px]; (0, 0) is the centre of the top-left pixel.
        xi: ξ ≥ 0.
        width, height: image size [px]; the image covers [−½, width−½] × [−½, height−½].
        skew: K[0, 1] [px].
        distortion: (k1, k2, p1, p2).
        max_angle: largest angle from the axis that the lens sees [rad], in (0, π], or None.
        dead_zone: where the image shows the camera itself; see `DeadZoneLike`.
        mask: where else it shows the camera itself, or nothing: at most 64 strictly convex polygons of 3 to
            64 corners (u, v) [px], in either order round.
        deviation_px: how far a true pixel may lie from `project`'s [px]: what a conversion from another model
            or a calibration leaves. Plans keep it in addition to their visibility margin.
        model_error: by how much the model is off, alike over regions of the image; estimates count it. A
            `ModelError`, its fields, or None: nothing is stated, and the model is taken as exact.
        calibration_covariance: (5, 5) of fx, fy, cx, cy, xi, or (9, 9) with k1, k2, p1, p2: how exactly they
            are known, as `Calibration.covariance`; estimates count it. None: nothing is stated.

    Raises:
        InputError: a number is not finite or not legal; the message names field, value and what is legal.
    """

    kernels: ClassVar[Kernels] = (unified_kernels.project_points, unified_kernels.unproject_pixels)

    fx: float
    fy: float
    cx: float
    cy: float
    xi: float
    width: int
    height: int
    skew: float
    distortion: tuple[float, float, float, float]
    max_angle: float | None
    dead_zone: DeadZone | None
    mask: ImageMask
    deviation_px: float
    model_error: ModelError | None
    calibration_covariance: CovarianceRows | None
    usable_angle: float = field(init=False, repr=False, compare=False)
    """Largest angle from the axis at which points can be projected [rad]."""
    parameters: FloatArray = field(init=False, repr=False, compare=False)
    """What the kernels read, (13,), read-only; `unified_kernels` names the places."""

    __setstate__ = frozen_again

    def __init__(
        self,
        fx: float,
        fy: float,
        cx: float,
        cy: float,
        xi: float,
        width: int,
        height: int,
        *,
        skew: float = 0.0,
        distortion: Sequence[float] = (0.0, 0.0, 0.0, 0.0),
        max_angle: float | None = None,
        dead_zone: DeadZoneLike = None,
        mask: Sequence[Sequence[Sequence[float]]] = (),
        deviation_px: float = 0.0,
        model_error: ModelError | Mapping[str, float] | None = None,
        calibration_covariance: npt.ArrayLike | None = None,
    ) -> None:
        self._set(
            fx=focal_length("fx", fx),
            fy=focal_length("fy", fy),
            cx=pixel_number("cx", cx),
            cy=pixel_number("cy", cy),
            xi=finite_number("xi", xi, minimum=0.0, maximum=_LARGEST_XI),
            width=image_size("width", width),
            height=image_size("height", height),
            skew=pixel_number("skew", skew),
            distortion=numbers("distortion", distortion, (4,), "four numbers [k1, k2, p1, p2]", 1e6),
            max_angle=largest_angle(max_angle),
            dead_zone=dead_zone_from(dead_zone),
            mask=mask_from(mask),
            deviation_px=finite_number("deviation_px", deviation_px, minimum=0.0, maximum=LARGEST_PX),
            model_error=model_error_from(model_error),
            calibration_covariance=covariance_from(calibration_covariance),
        )
        self._bound_domain()

    def _set(self, **fields: Any) -> None:
        for name, value in fields.items():
            object.__setattr__(self, name, value)

    def _bound_domain(self) -> None:
        """Find the usable domain from the model, the lens and the distortion."""
        cosine, r2 = model_domain(self.xi)
        angle = math.acos(cosine)
        if self.max_angle is not None and self.max_angle < angle:
            angle = self.max_angle
            cosine = max(cosine, math.cos(angle) - _ANGLE_SLACK)
            if cosine + self.xi > 0.0:  # else the lens ends with the model, to the rounding
                r2 = min(r2, (math.sin(angle) / (cosine + self.xi)) ** 2)
        radius = largest_invertible_radius(self.distortion)
        if radius * radius < r2:
            r2 = radius * radius
            cosine = max(cosine, cosine_of_radius(self.xi, radius))
            angle = min(angle, math.acos(cosine))
        r2 *= 1.0 + _RADIUS_SLACK
        reach = largest_distorted_radius(self.distortion, math.sqrt(r2)) * (1.0 + 1e-12)
        values = [self.fx, self.fy, self.cx, self.cy, self.skew, self.xi, *self.distortion]
        parameters = frozen(np.array([*values, cosine, r2, reach * reach]))
        self._set(usable_angle=angle, parameters=parameters)

    @property
    def matrix(self) -> FloatArray:
        """K (3, 3) [px]."""
        return np.array([[self.fx, self.skew, self.cx], [0.0, self.fy, self.cy], [0.0, 0.0, 1.0]])

    @property
    def is_distorted(self) -> bool:
        """Whether any of k1, k2, p1, p2 differs from 0."""
        return any(self.distortion)

    def project_jacobian(self, points: npt.ArrayLike) -> tuple[FloatArray, FloatArray, BoolArray]:
        """Project points (…, 3) [m] with ∂pixel/∂point.

        Returns:
            pixels (…, 2) [px], jacobian (…, 2, 3) [px/m], valid (…); NaN where not valid.
        """
        rows, shape = rows_of("points", points, 3)
        n = len(rows)
        pixels, jacobian, valid = np.empty((n, 2)), np.empty((n, 2, 3)), np.empty(n, dtype=np.bool_)
        unified_kernels.project_points_jacobian(self.parameters, rows, pixels, jacobian, valid)
        return pixels.reshape(*shape, 2), jacobian.reshape(*shape, 2, 3), valid.reshape(shape)

    def unproject_jacobian(self, pixels: npt.ArrayLike) -> tuple[FloatArray, FloatArray, BoolArray]:
        """Unproject pixels (…, 2) [px] with ∂bearing/∂pixel.

        Returns:
            bearings (…, 3), jacobian (…, 3, 2) [1/px], valid (…); NaN where not valid. On the rim of a
            fisheye's domain (r² = 1/(ξ²−1)) the derivative is infinite: there valid is False.
        """
        rows, shape = rows_of("pixels", pixels, 2)
        results, valid = np.empty((len(rows), 9)), np.empty(len(rows), dtype=np.bool_)
        unified_kernels.unproject_pixels_jacobian(self.parameters, rows, results, valid)
        bearings, jacobian = results[:, :3].copy(), results[:, 3:].copy()
        return bearings.reshape(*shape, 3), jacobian.reshape(*shape, 3, 2), valid.reshape(shape)

    def image_limits(self, margin_px: float = 0.0) -> ImageLimits:
        """Return what the image shows, every limit moved inward by ``margin_px`` [px], as cones.

        See `ImageLimits` and `omniservo.cameras.image_limits.image_limits`.
        """
        return image_limits(self, margin_px)

    def to_dict(self) -> dict[str, Any]:
        """Return the camera as it stands in a problem file; `from_dict` gives an equal camera."""
        names, rows = (*_REQUIRED[:4], "skew", "xi"), self.calibration_covariance
        return {
            "model": "unified",
            **{name: getattr(self, name) for name in names},
            "distortion": list(self.distortion),
            **image_to_dict(self, self.max_angle),
            **errors_to_dict(self),
            **({} if rows is None else {"calibration_covariance": [list(row) for row in rows]}),
        }

    @classmethod
    def from_dict(cls, fields: Mapping[str, Any], source: str = "camera") -> UnifiedCamera:
        """Return the camera that a problem file states.

        Args:
            fields: model ("unified"), fx, fy, cx, cy, xi, width, height; optional skew, distortion,
                max_angle, dead_zone, mask, deviation_px, model_error, calibration_covariance.
            source: stands first in messages.

        Raises:
            InputError: a field is missing, unknown or not legal.
        """
        given = checked_fields(fields, source, "unified", _REQUIRED, _OPTIONAL)
        try:
            return cls(**given)
        except InputError as error:
            raise InputError(f"{source}: {error}") from None
