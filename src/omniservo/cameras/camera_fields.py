"""The checks that every camera's fields and arguments pass, and what follows from its image alone."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence, Set
from typing import Any, Protocol

import numpy as np
import numpy.typing as npt

from omniservo.cameras.dead_zone import LARGEST_PX, DeadZone
from omniservo.cameras.image_mask import ImageMask, distance_beyond
from omniservo.errors import InputError, did_you_mean, spelled, spelled_name
from omniservo.geometry.arrays import BoolArray, FloatArray, finite_number, refuse_masked

_LARGEST_IMAGE = 100_000
_LEAST_FOCAL = 1e-6


class ImageFields(Protocol):
    """A camera's image: its size and the parts of it that show nothing of the scene."""

    @property
    def width(self) -> int:
        """Of the image [px]."""

    @property
    def height(self) -> int:
        """Of the image [px]."""

    @property
    def dead_zone(self) -> DeadZone | None:
        """The disc that shows the camera itself."""

    @property
    def mask(self) -> ImageMask:
        """The polygons that show the camera itself, or nothing."""


def rows_of(name: str, value: npt.ArrayLike, width: int) -> tuple[FloatArray, tuple[int, ...]]:
    """Return ``value`` (…, width) as contiguous float64 rows, and the shape of its leading axes.

    Raises:
        InputError: not numbers, another last axis, or with masked entries.
    """
    refuse_masked(name, value)
    try:
        array = np.asarray(value)
    except ValueError:
        raise InputError(f"{name}: rows of different lengths given; numbers (…, {width}) needed") from None
    if array.dtype.kind not in "fiu" or array.ndim == 0 or array.shape[-1] != width:
        raise InputError(f"{name}: {array.dtype} of shape {array.shape} given; numbers (…, {width}) needed")
    shape = array.shape[:-1]
    return np.ascontiguousarray(array.reshape(-1, width), dtype=np.float64), shape


def focal_length(name: str, value: Any) -> float:
    """Return a focal length [px]: not 0, of either sign."""
    number = pixel_number(name, value)
    if abs(number) < _LEAST_FOCAL:
        raise InputError(f"{name}: {number:g} given; legal: at least {_LEAST_FOCAL:g} in size")
    return number


def pixel_number(name: str, value: Any) -> float:
    """Return a coordinate or length in the image [px]."""
    return finite_number(name, value, minimum=-LARGEST_PX, maximum=LARGEST_PX)


def image_size(name: str, value: Any) -> int:
    """Return a width or height [px]: a whole number."""
    number = finite_number(name, value, minimum=1.0, maximum=_LARGEST_IMAGE)
    if number != int(number):
        raise InputError(f"{name}: {number:g} given; a whole number of pixels is needed")
    return int(number)


def largest_angle(value: Any) -> float | None:
    """Return ``max_angle`` [rad], in (0, π], or None."""
    return None if value is None else finite_number("max_angle", value, above=0.0, maximum=math.pi)


def numbers(name: str, value: Any, counts: Sequence[int], meaning: str, largest: float) -> tuple[float, ...]:
    """Return as many finite numbers as one of ``counts`` says, none larger than ``largest`` in size."""
    if (
        isinstance(value, str | bytes | Mapping | Set)
        or not hasattr(value, "__len__")
        or len(value) not in counts
    ):
        raise InputError(f"{name}: {spelled(value)} given; legal: {meaning}")
    return tuple(finite_number(name, k, minimum=-largest, maximum=largest) for k in value)


def inside_image(camera: ImageFields, pixels: npt.ArrayLike) -> BoolArray:
    """Say which pixels (…, 2) [px] lie in [−½, W−½] × [−½, H−½], outside the dead zone and the mask."""
    rows, shape = rows_of("pixels", pixels, 2)
    u, v = rows[:, 0], rows[:, 1]
    inside = (u >= -0.5) & (u <= camera.width - 0.5) & (v >= -0.5) & (v <= camera.height - 0.5)
    if camera.dead_zone is not None:
        du, dv = u - camera.dead_zone.center[0], v - camera.dead_zone.center[1]
        inside &= np.hypot(du, dv) >= camera.dead_zone.radius
    inside &= distance_beyond(camera.mask, rows) >= 0.0
    return np.asarray(inside.reshape(shape), dtype=np.bool_)


def image_to_dict(camera: ImageFields, max_angle: float | None) -> dict[str, Any]:
    """Return size, ``max_angle``, dead zone and mask as they stand in a file; no mask where there is none."""
    zone = camera.dead_zone
    polygons = [[list(corner) for corner in polygon] for polygon in camera.mask]
    return {
        "width": camera.width,
        "height": camera.height,
        "max_angle": max_angle,
        "dead_zone": None if zone is None else {"center": list(zone.center), "radius": zone.radius},
        **({"mask": polygons} if polygons else {}),
    }


def errors_to_dict(camera: Any) -> dict[str, Any]:
    """Return how far a camera may be off as it stands in a file; nothing where nothing is stated."""
    deviation = {"deviation_px": camera.deviation_px} if camera.deviation_px else {}
    stated = camera.model_error
    return {**deviation, **({} if stated is None else {"model_error": stated.to_dict()})}


def checked_fields(
    fields: Any, source: str, model: str, required: Sequence[str], optional: Sequence[str]
) -> dict[str, Any]:
    """Return a camera's fields without "model"; optional ones that are null are left out.

    Raises:
        InputError: not a mapping, a field is missing or unknown, or it is of another model.
    """
    if not isinstance(fields, Mapping):
        raise InputError(f"{source}: {type(fields).__name__} given; a mapping of fields is needed")
    required, legal = ("model", *required), ("model", *required, *optional)
    missing = [name for name in required if name not in fields]
    if missing:
        raise InputError(f"{source}: {missing[0]}: missing; needed: {', '.join(required)}")
    unknown = [str(name) for name in fields if name not in legal]
    if unknown:
        raise InputError(
            f"{source}: {spelled_name(unknown[0])}: no such field; legal: {', '.join(legal)}"
            f"{did_you_mean(unknown[0], legal)}"
        )
    if fields["model"] != model:
        raise InputError(f"{source}: model: {spelled(fields['model'])} given; legal: {model!r}")
    return {k: v for k, v in fields.items() if k != "model" and not (k in optional and v is None)}
