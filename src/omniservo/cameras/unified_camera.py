"""The unified camera: every central camera from perspective to fisheye and mirror, with its domain."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
import numpy.typing as npt

from omniservo.cameras import unified_kernels as kernels
from omniservo.cameras.dead_zone import LARGEST_PX, DeadZone, DeadZoneLike, dead_zone_from
from omniservo.cameras.distortion import largest_distorted_radius, largest_invertible_radius
from omniservo.cameras.domain_warnings import domain_warnings
from omniservo.cameras.image_limits import ImageLimits, image_limits
from omniservo.cameras.image_mask import ImageMask, distance_beyond, mask_from
from omniservo.cameras.model_domain import cosine_of_radius, model_domain
from omniservo.errors import InputError, spelled, spelled_name
from omniservo.geometry.arrays import BoolArray, FloatArray, finite_number, frozen

_LARGEST_IMAGE = 100_000
_LARGEST_XI = 1e6
_LEAST_FOCAL = 1e-6
_ANGLE_SLACK = 1e-15
"""on the cosine of max_angle: a point at that angle is inside, whatever the rounding"""

_RADIUS_SLACK = 1e-13
"""on r²: the rounded pixel of a valid point can be unprojected"""

_REQUIRED = ("model", "fx", "fy", "cx", "cy", "xi", "width", "height")
_OPTIONAL = ("skew", "distortion", "max_angle", "dead_zone", "mask", "deviation_px")


@dataclass(frozen=True, init=False)
class UnifiedCamera:
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
            64 corners (u, v) [px], in either order round. Not together with distortion.
        deviation_px: how far a true pixel may lie from `project`'s [px]: what a conversion from another model
            or a calibration leaves. Plans keep it in addition to their visibility margin.

    Raises:
        InputError: a number is not finite or not legal; the message names field, value and what is legal.
    """

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
    usable_angle: float = field(init=False, repr=False, compare=False)
    """Largest angle from the axis at which points can be projected [rad]."""
    parameters: FloatArray = field(init=False, repr=False, compare=False)
    """What the kernels read, (13,), read-only; `unified_kernels` says what stands where."""

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
    ) -> None:
        self._set(
            fx=_focal_length("fx", fx),
            fy=_focal_length("fy", fy),
            cx=_within("cx", cx),
            cy=_within("cy", cy),
            xi=finite_number("xi", xi, minimum=0.0, maximum=_LARGEST_XI),
            width=_size("width", width),
            height=_size("height", height),
            skew=_within("skew", skew),
            distortion=_coefficients(distortion),
            max_angle=max_angle if max_angle is None else _angle(max_angle),
            dead_zone=dead_zone_from(dead_zone),
            mask=mask_from(mask),
            deviation_px=finite_number("deviation_px", deviation_px, minimum=0.0, maximum=LARGEST_PX),
        )
        if self.mask and self.is_distorted:
            raise InputError("mask: given with distortion; both together are not supported yet")
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

    @property
    def warnings(self) -> tuple[str, ...]:
        """What a person must know: where the formula stops being one-to-one inside the image."""
        return domain_warnings(self)

    def project(self, points: npt.ArrayLike) -> tuple[FloatArray, BoolArray]:
        """Project points in the camera frame.

        Args:
            points: (…, 3) [m]; a NaN or infinite point is not valid.

        Returns:
            pixels (…, 2) [px], NaN where not valid; valid (…): the point is in the domain (the pixel
            may lie outside the image: see `in_image`).

        Raises:
            InputError: not numbers, or the last axis is not 3.
        """
        rows, shape = _rows("points", points, 3)
        pixels, valid = np.empty((len(rows), 2)), np.empty(len(rows), dtype=np.bool_)
        kernels.project_points(self.parameters, rows, pixels, valid)
        return pixels.reshape(*shape, 2), valid.reshape(shape)

    def project_jacobian(self, points: npt.ArrayLike) -> tuple[FloatArray, FloatArray, BoolArray]:
        """Project points (…, 3) [m] with ∂pixel/∂point.

        Returns:
            pixels (…, 2) [px], jacobian (…, 2, 3) [px/m], valid (…); NaN where not valid.
        """
        rows, shape = _rows("points", points, 3)
        n = len(rows)
        pixels, jacobian, valid = np.empty((n, 2)), np.empty((n, 2, 3)), np.empty(n, dtype=np.bool_)
        kernels.project_points_jacobian(self.parameters, rows, pixels, jacobian, valid)
        return pixels.reshape(*shape, 2), jacobian.reshape(*shape, 2, 3), valid.reshape(shape)

    def unproject(self, pixels: npt.ArrayLike) -> tuple[FloatArray, BoolArray]:
        """Return the bearings that pixels see.

        Args:
            pixels: (…, 2) [px]; a NaN or infinite pixel is not valid.

        Returns:
            bearings (…, 3), unit vectors in the camera frame, NaN where not valid; valid (…): the pixel is
            in the model's domain, within ``max_angle`` and where the distortion is one-to-one.

        Raises:
            InputError: not numbers, or the last axis is not 2.
        """
        rows, shape = _rows("pixels", pixels, 2)
        bearings, valid = np.empty((len(rows), 3)), np.empty(len(rows), dtype=np.bool_)
        kernels.unproject_pixels(self.parameters, rows, bearings, valid)
        return bearings.reshape(*shape, 3), valid.reshape(shape)

    def unproject_jacobian(self, pixels: npt.ArrayLike) -> tuple[FloatArray, FloatArray, BoolArray]:
        """Unproject pixels (…, 2) [px] with ∂bearing/∂pixel.

        Returns:
            bearings (…, 3), jacobian (…, 3, 2) [1/px], valid (…); NaN where not valid. On the rim of a
            fisheye's domain (r² = 1/(ξ²−1)) the derivative is infinite: there valid is False.
        """
        rows, shape = _rows("pixels", pixels, 2)
        results, valid = np.empty((len(rows), 9)), np.empty(len(rows), dtype=np.bool_)
        kernels.unproject_pixels_jacobian(self.parameters, rows, results, valid)
        bearings, jacobian = results[:, :3].copy(), results[:, 3:].copy()
        return bearings.reshape(*shape, 3), jacobian.reshape(*shape, 3, 2), valid.reshape(shape)

    def in_image(self, pixels: npt.ArrayLike) -> BoolArray:
        """Say which pixels (…, 2) [px] lie in [−½, W−½] × [−½, H−½], outside the dead zone and the mask."""
        rows, shape = _rows("pixels", pixels, 2)
        u, v = rows[:, 0], rows[:, 1]
        inside = (u >= -0.5) & (u <= self.width - 0.5) & (v >= -0.5) & (v <= self.height - 0.5)
        if self.dead_zone is not None:
            du, dv = u - self.dead_zone.center[0], v - self.dead_zone.center[1]
            inside &= np.hypot(du, dv) >= self.dead_zone.radius
        inside &= distance_beyond(self.mask, rows) >= 0.0
        return np.asarray(inside.reshape(shape), dtype=np.bool_)

    def image_limits(self, margin_px: float = 0.0) -> ImageLimits:
        """Return what the image shows, every limit moved inward by ``margin_px`` [px], as cones.

        See `ImageLimits` and `omniservo.cameras.image_limits.image_limits`.
        """
        return image_limits(self, margin_px)

    def to_dict(self) -> dict[str, Any]:
        """Return the camera as it stands in a problem file; `from_dict` gives an equal camera."""
        names = (*_REQUIRED[1:5], "skew", "xi")
        numbers: dict[str, Any] = {name: getattr(self, name) for name in names}
        zone = self.dead_zone
        polygons = [[list(corner) for corner in polygon] for polygon in self.mask]
        return {
            "model": "unified",
            **numbers,
            "distortion": list(self.distortion),
            "width": self.width,
            "height": self.height,
            "max_angle": self.max_angle,
            "dead_zone": None if zone is None else {"center": list(zone.center), "radius": zone.radius},
            **({"mask": polygons} if polygons else {}),
            **({"deviation_px": self.deviation_px} if self.deviation_px else {}),
        }

    @classmethod
    def from_dict(cls, fields: Mapping[str, Any], source: str = "camera") -> UnifiedCamera:
        """Return the camera that a problem file states.

        Args:
            fields: model ("unified"), fx, fy, cx, cy, xi, width, height; optional skew, distortion,
                max_angle, dead_zone, mask, deviation_px.
            source: stands first in messages.

        Raises:
            InputError: a field is missing, unknown or not legal.
        """
        if not isinstance(fields, Mapping):
            raise InputError(f"{source}: {type(fields).__name__} given; a mapping of fields is needed")
        missing = [name for name in _REQUIRED if name not in fields]
        if missing:
            raise InputError(f"{source}: {missing[0]}: missing; needed: {', '.join(_REQUIRED)}")
        unknown = [str(name) for name in fields if name not in _REQUIRED + _OPTIONAL]
        if unknown:
            name, legal = spelled_name(unknown[0]), ", ".join(_REQUIRED + _OPTIONAL)
            raise InputError(f"{source}: {name}: no such field; legal: {legal}")
        if fields["model"] != "unified":
            raise InputError(f"{source}: model: {spelled(fields['model'])} given; legal: 'unified'")
        given = {name: value for name, value in fields.items() if name != "model"}
        for name, default in (("skew", 0.0), ("distortion", (0.0,) * 4), ("mask", ()), ("deviation_px", 0.0)):
            if given.get(name, 0.0) is None:
                given[name] = default
        try:
            return cls(**given)
        except InputError as error:
            raise InputError(f"{source}: {error}") from None


def _rows(name: str, value: npt.ArrayLike, width: int) -> tuple[FloatArray, tuple[int, ...]]:
    """Return ``value`` (…, width) as contiguous float64 rows, and the shape of its leading axes."""
    try:
        array = np.asarray(value)
    except ValueError:
        raise InputError(f"{name}: rows of different lengths given; numbers (…, {width}) needed") from None
    if array.dtype.kind not in "fiu" or array.ndim == 0 or array.shape[-1] != width:
        raise InputError(f"{name}: {array.dtype} of shape {array.shape} given; numbers (…, {width}) needed")
    shape = array.shape[:-1]
    return np.ascontiguousarray(array.reshape(-1, width), dtype=np.float64), shape


def _focal_length(name: str, value: Any) -> float:
    number = _within(name, value)
    if abs(number) < _LEAST_FOCAL:
        raise InputError(f"{name}: {number:g} given; legal: at least {_LEAST_FOCAL:g} in size")
    return number


def _within(name: str, value: Any) -> float:
    return finite_number(name, value, minimum=-LARGEST_PX, maximum=LARGEST_PX)


def _size(name: str, value: Any) -> int:
    number = finite_number(name, value, minimum=1.0, maximum=_LARGEST_IMAGE)
    if number != int(number):
        raise InputError(f"{name}: {number:g} given; a whole number of pixels is needed")
    return int(number)


def _coefficients(value: Any) -> tuple[float, float, float, float]:
    if isinstance(value, str | bytes) or not hasattr(value, "__len__") or len(value) != 4:
        raise InputError(f"distortion: {spelled(value)} given; legal: four numbers [k1, k2, p1, p2]")
    k1, k2, p1, p2 = (finite_number("distortion", k, minimum=-1e6, maximum=1e6) for k in value)
    return k1, k2, p1, p2


def _angle(value: Any) -> float:
    return finite_number("max_angle", value, above=0.0, maximum=math.pi)
