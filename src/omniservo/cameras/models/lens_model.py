"""What all models of this room share: image and lens fields, the domain's numbers, both directions."""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from collections.abc import Callable, Mapping
from dataclasses import MISSING, dataclass, field, fields
from typing import Any, ClassVar, TypeVar

import numpy as np
import numpy.typing as npt

from omniservo.cameras.camera_fields import (
    checked_fields,
    focal_length,
    image_size,
    image_to_dict,
    inside_image,
    largest_angle,
    pixel_number,
    rows_of,
)
from omniservo.cameras.dead_zone import DeadZone, dead_zone_from
from omniservo.cameras.domain_warnings import domain_warnings
from omniservo.cameras.image_mask import ImageMask, mask_from
from omniservo.errors import InputError
from omniservo.geometry.arrays import BoolArray, FloatArray, frozen

_COSINE_SLACK = 1e-15
"""a point at the largest angle itself is inside, whatever the rounding"""

_SLACK = 2e-13
"""on r: the rounded pixel of a valid point can be unprojected"""

_LARGEST_SQUARE = 1e280

Kernels = tuple[
    Callable[[FloatArray, FloatArray, FloatArray, BoolArray], None],
    Callable[[FloatArray, FloatArray, FloatArray, BoolArray], None],
]
"""(parameters, points, pixels, valid) and (parameters, pixels, bearings, valid); the last two are written"""

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


class _Sized:
    width: int
    height: int


@dataclass(frozen=True, kw_only=True)
class LensModel(_Sized, ABC):
    """A central model whose plane m goes to pixels by an affine map, with its lens's limits.

    Kernels read ``parameters``: 0–3 the affine map's matrix row by row, 4, 5 its offset (cx, cy), 6–9 the
    inverse matrix, 10 the least Z/ρ, 11 the largest ‖m‖², 12 the same with what rounding needs, 13 … the
    model's own. Models are values: equal when all their numbers are, and keys of a dict.

    Args:
        max_angle: largest angle from the axis that the lens sees [rad], in (0, π], or None.
        dead_zone: where the image shows the camera itself; anything that `DeadZoneLike` allows.
        mask: convex polygons [px] in which it shows the camera itself, or nothing.
    """

    max_angle: float | None = None
    dead_zone: DeadZone | None = None
    mask: ImageMask = ()
    usable_angle: float = field(init=False, repr=False, compare=False)
    """Largest angle from the axis at which points can be projected [rad]."""
    parameters: FloatArray = field(init=False, repr=False, compare=False)
    """What the kernels read; read-only."""

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
        rows, shape = rows_of("points", points, 3)
        pixels, valid = np.empty((len(rows), 2)), np.empty(len(rows), dtype=np.bool_)
        self.kernels[0](self.parameters, rows, pixels, valid)
        return pixels.reshape(*shape, 2), valid.reshape(shape)

    def unproject(self, pixels: npt.ArrayLike) -> tuple[FloatArray, BoolArray]:
        """Return the bearings that pixels see.

        Args:
            pixels: (…, 2) [px]; a NaN or infinite pixel is not valid.

        Returns:
            bearings (…, 3), unit vectors in the camera frame, NaN where not valid; valid (…): the pixel is
            in the domain.

        Raises:
            InputError: not numbers, or the last axis is not 2.
        """
        rows, shape = rows_of("pixels", pixels, 2)
        bearings, valid = np.empty((len(rows), 3)), np.empty(len(rows), dtype=np.bool_)
        self.kernels[1](self.parameters, rows, bearings, valid)
        return bearings.reshape(*shape, 3), valid.reshape(shape)

    def in_image(self, pixels: npt.ArrayLike) -> BoolArray:
        """Say which pixels (…, 2) [px] lie in [−½, W−½] × [−½, H−½], outside the dead zone and the mask."""
        return inside_image(self, pixels)

    def to_dict(self) -> dict[str, Any]:
        """Return the model as it stands in a file; `camera_from_dict` gives an equal one."""
        lens = image_to_dict(self, self.max_angle)
        own = {
            f.name: getattr(self, f.name) for f in fields(self) if f.init and f.name not in (*lens, "mask")
        }
        plain = {name: list(value) if isinstance(value, tuple) else value for name, value in own.items()}
        return {"model": self.model, **plain, **lens}

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
