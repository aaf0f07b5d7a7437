"""What all models of this room share: image and lens fields, the domain's numbers, both directions."""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from collections.abc import Mapping
from dataclasses import MISSING, dataclass, field, fields
from typing import Any, ClassVar, TypeVar

import numpy as np
import numpy.typing as npt

from omniservo.cameras.camera_fields import (
    checked_fields,
    errors_to_dict,
    focal_length,
    image_size,
    image_to_dict,
    largest_angle,
    pixel_number,
)
from omniservo.cameras.dead_zone import LARGEST_PX, DeadZone, dead_zone_from
from omniservo.cameras.image_mask import ImageMask, mask_from
from omniservo.cameras.kernel_camera import KernelCamera, Kernels
from omniservo.cameras.model_error import ModelError, model_error_from
from omniservo.errors import InputError
from omniservo.geometry.arrays import BoolArray, FloatArray, finite_number, frozen, frozen_again

_COSINE_SLACK = 1e-15
"""a point at the largest angle itself is inside, whatever the rounding"""

_SLACK = 2e-13
"""on r: the rounded pixel of a valid point can be unprojected"""

_LARGEST_SQUARE = 1e280

_POINT_STEP = 1e-5
"""over a point's distance"""

_PIXEL_STEP = 1e-2
"""[px]"""

Model = TypeVar("Model", bound="LensModel")


@dataclass(frozen=True)
class Domain:
    """Where a model is one-to-one: up to an angle from the axis, and to a radius on its plane."""

    angle: float
    """[rad]"""
    radius: float
    """of the plane's disc, in the plane's unit; may be infinite"""
    own: FloatArray
    """the model's own numbers for the kernels"""


@dataclass(frozen=True, kw_only=True, repr=False)
class LensModel(KernelCamera, ABC):
    """A central model whose plane m goes to pixels by an affine map, with its lens's limits.

    Models are values: equal when all their numbers are, and keys of a dict.

    Args:
        max_angle: largest angle from the axis that the lens sees [rad], in (0, π], or None.
        dead_zone: where the image shows the camera itself; anything that `DeadZoneLike` allows.
        mask: convex polygons [px] in which it shows the camera itself, or nothing.
        deviation_px: how far a true pixel may lie from `project`'s [px]; conversions add what they leave.
        model_error: as `UnifiedCamera`'s.
    """

    max_angle: float | None = None
    dead_zone: DeadZone | None = None
    mask: ImageMask = ()
    deviation_px: float = 0.0
    model_error: ModelError | None = None
    usable_angle: float = field(init=False, repr=False, compare=False)
    """Largest angle from the axis at which points can be projected [rad]."""
    parameters: FloatArray = field(init=False, repr=False, compare=False)
    """What the kernels read, read-only; `plane_kernels` and the model's own name the places."""

    __setstate__ = frozen_again

    model: ClassVar[str]
    kernels: ClassVar[Kernels]

    def __post_init__(self) -> None:
        self._set(
            **self._checked(),
            width=image_size("width", self.width),
            height=image_size("height", self.height),
            max_angle=largest_angle(self.max_angle),
            dead_zone=dead_zone_from(self.dead_zone),
            mask=mask_from(self.mask),
            deviation_px=finite_number("deviation_px", self.deviation_px, minimum=0.0, maximum=LARGEST_PX),
            model_error=model_error_from(self.model_error),
        )
        domain = self._domain(math.pi if self.max_angle is None else self.max_angle)
        matrix, (cx, cy) = self._affine()
        smallest = float(np.linalg.svd(matrix, compute_uv=False)[-1])
        radius = min(domain.radius, math.sqrt(_LARGEST_SQUARE))
        wider = radius * (1.0 + _SLACK) + 1e-15 * (abs(cx) + abs(cy)) / smallest
        limits = [math.cos(domain.angle) - _COSINE_SLACK, radius**2 * (1.0 + 0.1 * _SLACK), wider**2]
        common = [*matrix.ravel(), cx, cy, *np.linalg.inv(matrix).ravel(), *limits]
        self._set(usable_angle=domain.angle, parameters=frozen(np.concatenate([common, domain.own])))

    @abstractmethod
    def _checked(self) -> dict[str, Any]:
        """Return the model's own fields, checked."""

    @abstractmethod
    def _domain(self, most: float) -> Domain:
        """Return the domain up to the angle ``most``, and the model's own parameters."""

    @abstractmethod
    def _affine(self) -> tuple[FloatArray, tuple[float, float]]:
        """Return the matrix (2, 2) and the offset (cx, cy) [px] from the plane to pixels."""

    def _set(self, **values: Any) -> None:
        for name, value in values.items():
            object.__setattr__(self, name, value)

    def project_jacobian(self, points: npt.ArrayLike) -> tuple[FloatArray, FloatArray, BoolArray]:
        """Project points (…, 3) [m] with ∂pixel/∂point, by central differences (to about 10⁻⁷ of it).

        Returns:
            pixels (…, 2) [px], jacobian (…, 2, 3) [px/m], valid (…); NaN where not valid, as within
            10⁻⁵ rad of the domain's border.
        """
        pixels, valid = self.project(points)
        centre = np.where(valid[..., None], np.asarray(points, dtype=np.float64), np.nan)
        step = _POINT_STEP * np.linalg.norm(centre, axis=-1)[..., None, None]
        ahead, behind = (self.project(centre[..., None, :] + s * step * np.eye(3))[0] for s in (1.0, -1.0))
        slopes = np.swapaxes((ahead - behind) / (2.0 * step), -1, -2)
        return _where_known(pixels, slopes, valid)

    def unproject_jacobian(self, pixels: npt.ArrayLike) -> tuple[FloatArray, FloatArray, BoolArray]:
        """Unproject pixels (…, 2) [px] with ∂bearing/∂pixel, by central differences (to about 10⁻⁷ of it).

        Returns:
            bearings (…, 3), jacobian (…, 3, 2) [1/px], valid (…); NaN where not valid, as within 0.01 px of
            the domain's border.
        """
        bearings, valid = self.unproject(pixels)
        centre = np.where(valid[..., None], np.asarray(pixels, dtype=np.float64), np.nan)[..., None, :]
        ahead, behind = (self.unproject(centre + s * _PIXEL_STEP * np.eye(2))[0] for s in (1.0, -1.0))
        slopes = np.swapaxes((ahead - behind) / (2.0 * _PIXEL_STEP), -1, -2)
        return _where_known(bearings, slopes, valid)

    def to_dict(self) -> dict[str, Any]:
        """Return the model as it stands in a file; `camera_from_dict` gives an equal one."""
        lens = image_to_dict(self, self.max_angle)
        optional = ("mask", "deviation_px", "model_error")
        own = {
            f.name: getattr(self, f.name) for f in fields(self) if f.init and f.name not in (*lens, *optional)
        }
        plain = {name: list(value) if isinstance(value, tuple) else value for name, value in own.items()}
        return {"model": self.model, **plain, **lens, **errors_to_dict(self)}

    @classmethod
    def from_dict(cls: type[Model], given: Mapping[str, Any], source: str = "camera") -> Model:
        """Return the model that a file states.

        Raises:
            InputError: a field is missing, unknown or not legal; ``source`` stands first in the message.
        """
        settable = [f for f in fields(cls) if f.init]
        required = [f.name for f in settable if f.default is MISSING]
        optional = [f.name for f in settable if f.default is not MISSING]
        try:
            return cls(**checked_fields(given, source, cls.model, required, optional))
        except InputError as error:
            text = str(error)
            raise InputError(text if text.startswith(source) else f"{source}: {text}") from None


def _where_known(
    values: FloatArray, slopes: FloatArray, valid: BoolArray
) -> tuple[FloatArray, FloatArray, BoolArray]:
    """Return both with NaN where either is not known, and where both are."""
    known = valid & np.isfinite(slopes).all(axis=(-2, -1))
    return (
        np.where(known[..., None], values, np.nan),
        np.where(known[..., None, None], slopes, np.nan),
        known,
    )


@dataclass(frozen=True)
class FocalModel(LensModel):
    """A model with focal lengths, which may have either sign, and a principal point [px]."""

    fx: float
    fy: float
    cx: float
    cy: float

    def _focal(self) -> dict[str, Any]:
        """Return the four, checked."""
        return {
            "fx": focal_length("fx", self.fx),
            "fy": focal_length("fy", self.fy),
            "cx": pixel_number("cx", self.cx),
            "cy": pixel_number("cy", self.cy),
        }

    def _affine(self) -> tuple[FloatArray, tuple[float, float]]:
        skew = getattr(self, "skew", 0.0)
        return np.array([[self.fx, skew], [0.0, self.fy]]), (self.cx, self.cy)
