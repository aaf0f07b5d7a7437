"""What another central camera at the same centre would see: an image resampled through bearings.

The view may be perspective (tangent to the sphere of view), cylindrical, equirectangular, or of any model:
each of its pixels shows what its bearing sees in the source image.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt
from scipy.spatial.transform import Rotation

from omniservo.cameras.camera_fields import image_size, numbers
from omniservo.cameras.cylindrical_view import CylindricalView
from omniservo.cameras.models.central_model import CentralModel
from omniservo.cameras.models.equirectangular import Equirectangular
from omniservo.cameras.unified_camera import UnifiedCamera
from omniservo.errors import InputError
from omniservo.field_docs import with_field_docs
from omniservo.geometry.arrays import BoolArray, FloatArray, finite_array, finite_number

_LARGEST_SIDE = 16384
_LARGEST_IMAGE = 2**26
"""pixels of a view"""
_AT_ONCE = 2**18
"""pixels"""

ViewCamera = CentralModel | CylindricalView


@with_field_docs
@dataclass(frozen=True, eq=False)
class RectifiedView:
    """An image as another central camera at the same centre sees it."""

    image: npt.NDArray[Any]
    """(h, w) or (h, w, channels), of the source's type; 0 where `valid` is False"""
    valid: BoolArray
    """(h, w): the source image shows what this pixel sees"""
    camera: ViewCamera
    """the camera that took the view; its frame is the view's"""
    camera_R_view: Rotation
    """turns directions in the view's frame into those in the source camera's frame"""

    def bearings(self, pixels: npt.ArrayLike) -> FloatArray:
        """Return the bearings (…, 3), in the source camera's frame, of pixels (…, 2) of the view."""
        rays = self.camera.unproject(pixels)[0]
        return np.asarray(self.camera_R_view.apply(rays.reshape(-1, 3)).reshape(rays.shape))


def rectify(
    camera: CentralModel,
    image: npt.NDArray[Any],
    view: ViewCamera,
    *,
    direction: npt.ArrayLike = (0.0, 0.0, 1.0),
    up: npt.ArrayLike | None = None,
) -> RectifiedView:
    """Return ``image``, resampled bilinearly, as ``view`` sees it when it looks in ``direction``.

    Args:
        camera: the image's camera, of any model.
        image: (height, width) or (height, width, channels), any real type.
        view: `perspective_view`, `cylindrical_view`, an `Equirectangular`, or a camera of any model.
        direction: (3,) the view's axis in the camera frame, any length but 0.
        up: (3,) what points up in the view, camera frame; default: up in the image, −y, or along the axis
            for a view straight up or down.

    Raises:
        InputError: the image is not the camera's, the view has more than 2²⁶ pixels, a direction is none, or
            ``up`` lies along ``direction``.
    """
    source = np.asarray(image)
    if source.ndim not in (2, 3) or source.shape[:2] != (camera.height, camera.width):
        size_needed = f"({camera.height}, {camera.width}) or with channels"
        raise InputError(f"image: shape {source.shape} given; the camera's is {size_needed}")
    if source.dtype.kind not in "uif":
        raise InputError(f"image: {source.dtype} given; numbers are needed")
    _refuse_large("view", view.width, view.height)
    camera_R_view = _orientation(direction, up)
    values = source if source.dtype.kind != "f" else source.astype(np.float64, copy=False)
    resampled = np.zeros((view.height, view.width, *source.shape[2:]), dtype=source.dtype)
    valid = np.zeros((view.height, view.width), dtype=np.bool_)
    for rows in _blocks(view.height, view.width):
        v, u = np.mgrid[rows, 0 : view.width].astype(np.float64)
        rays, there = view.unproject(np.stack([u, v], axis=-1))
        pixels, seen = camera.project(camera_R_view.apply(rays.reshape(-1, 3)).reshape(rays.shape))
        valid[rows] = there & seen & camera.in_image(np.where(seen[..., None], pixels, -1e6))
        block = _resampled(values, pixels, valid[rows])
        resampled[rows] = np.rint(block) if resampled.dtype.kind in "ui" else block
    return RectifiedView(resampled, valid, view, camera_R_view)


def _blocks(height: int, width: int) -> Iterator[slice]:
    """Yield the rows that are resampled at once: large views need little memory."""
    rows = max(1, _AT_ONCE // width)
    for first in range(0, height, rows):
        yield slice(first, min(first + rows, height))


def tangent_view(
    camera: CentralModel,
    image: npt.NDArray[Any],
    direction: npt.ArrayLike,
    field_of_view: float,
    size: tuple[int, int],
    up: npt.ArrayLike | None = None,
) -> RectifiedView:
    """Return the perspective view in ``direction``: straight lines of the world are straight in it.

    See `rectify` and `perspective_view`.
    """
    return rectify(camera, image, perspective_view(field_of_view, size), direction=direction, up=up)


def perspective_view(field_of_view: float, size: tuple[int, int]) -> UnifiedCamera:
    """Return the perspective camera of a view, ξ = 0.

    Args:
        field_of_view: horizontal, between the view's left and right border, in (0, π) [rad].
        size: (width, height) [px].
    """
    width, height = _size(size)
    angle = finite_number("field_of_view", field_of_view, above=0.0)
    if angle >= math.pi:
        raise InputError(f"field_of_view: {angle:g} given; legal: less than π; a plane shows no more")
    focal = 0.5 * width / math.tan(0.5 * angle)
    return UnifiedCamera(focal, focal, 0.5 * (width - 1), 0.5 * (height - 1), 0.0, width, height)


def cylindrical_view(field_of_view: float, size: tuple[int, int]) -> CylindricalView:
    """Return the cylinder of a view, upright: columns are meridians.

    Args:
        field_of_view: horizontal, in (0, 2π] [rad].
        size: (width, height) [px].
    """
    width, height = _size(size)
    angle = finite_number("field_of_view", field_of_view, above=0.0)
    if angle > 2.0 * math.pi * (1.0 + 1e-12):
        raise InputError(f"field_of_view: {angle:g} given; legal: at most 2π")
    return CylindricalView(width, height, width / angle)


def equirectangular_view(size: tuple[int, int]) -> Equirectangular:
    """Return the whole sphere, (width, height) [px]; twice as wide as high shows it evenly."""
    return Equirectangular(*_size(size))


def _size(size: tuple[int, int]) -> tuple[int, int]:
    sides = numbers("size", size, (2,), "(width, height)", _LARGEST_SIDE)
    width, height = (image_size("size", side) for side in sides)
    _refuse_large("size", width, height)
    return width, height


def _refuse_large(name: str, width: int, height: int) -> None:
    if width * height > _LARGEST_IMAGE:
        raise InputError(f"{name}: {width}x{height} given; legal: at most {_LARGEST_IMAGE} pixels")


def _orientation(direction: npt.ArrayLike, up: npt.ArrayLike | None) -> Rotation:
    axis = finite_array("direction", direction, (3,))
    length = float(np.linalg.norm(axis))
    if not 0.0 < length < math.inf:
        raise InputError(f"direction: {axis.tolist()} given; any finite vector but 0")
    z = axis / length
    if up is None:
        upwards = np.array([0.0, -1.0, 0.0]) if abs(z[1]) < 0.999 else np.array([0.0, 0.0, 1.0])
    else:
        upwards = finite_array("up", up, (3,))
    x = np.cross(-upwards, z)
    sine = float(np.linalg.norm(x))
    if not sine > 1e-9 * float(np.linalg.norm(upwards)):
        raise InputError(f"up: {upwards.tolist()} given; it must not lie along direction {axis.tolist()}")
    x /= sine
    return Rotation.from_matrix(np.column_stack([x, np.cross(z, x), z]))


def _resampled(source: npt.NDArray[Any], pixels: FloatArray, valid: BoolArray) -> FloatArray:
    from scipy.ndimage import map_coordinates  # slow to import, and few views are resampled

    coordinates = [np.where(valid, pixels[..., 1], 0.0), np.where(valid, pixels[..., 0], 0.0)]
    channels = source[..., None] if source.ndim == 2 else source
    planes = [
        map_coordinates(channels[..., c], coordinates, np.float64, order=1, mode="nearest")
        for c in range(channels.shape[2])
    ]
    view = np.where(valid[..., None], np.stack(planes, axis=-1), 0.0)
    return np.asarray(view[..., 0] if source.ndim == 2 else view)
