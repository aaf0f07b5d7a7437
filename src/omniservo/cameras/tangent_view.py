"""What a perspective camera at the same centre would see: an undistorted cut-out of any camera's image."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt
from scipy.ndimage import map_coordinates
from scipy.spatial.transform import Rotation

from omniservo.cameras.unified_camera import UnifiedCamera
from omniservo.errors import InputError
from omniservo.geometry.arrays import BoolArray, FloatArray, finite_array, finite_number

_LARGEST_SIDE = 16384


@dataclass(frozen=True, eq=False)
class TangentView:
    """A perspective image tangent to the sphere of view at some direction; straight lines are straight."""

    image: npt.NDArray[Any]
    """(h, w) or (h, w, channels), of the source's type; 0 where `valid` is False"""
    valid: BoolArray
    """(h, w): the source image shows what this pixel sees"""
    camera: UnifiedCamera
    """the perspective camera (ξ = 0) that took the view"""
    camera_R_view: Rotation
    """turns directions in the view's frame into those in the source camera's frame"""

    def bearings(self, pixels: npt.ArrayLike) -> FloatArray:
        """Return the bearings (…, 3), in the source camera's frame, of pixels (…, 2) of the view."""
        rays = self.camera.unproject(pixels)[0]
        return np.asarray(self.camera_R_view.apply(rays.reshape(-1, 3)).reshape(rays.shape))


def tangent_view(
    camera: UnifiedCamera,
    image: npt.NDArray[Any],
    direction: npt.ArrayLike,
    field_of_view: float,
    size: tuple[int, int],
    up: npt.ArrayLike | None = None,
) -> TangentView:
    """Return the perspective view in ``direction``, resampled bilinearly from a camera's image.

    Args:
        camera: the image's camera.
        image: (height, width) or (height, width, channels), any real type.
        direction: (3,) the view's axis in the camera frame, any length but 0.
        field_of_view: horizontal, between the view's left and right border, in (0, π) [rad].
        size: (width, height) of the view [px].
        up: (3,) what points up in the view, camera frame; default: up in the image, −y, or along the axis
            for a view straight up or down.

    Raises:
        InputError: sizes that do not match, a field of view or direction that is none, or ``up`` along
            ``direction``.
    """
    source = np.asarray(image)
    if source.ndim not in (2, 3) or source.shape[:2] != (camera.height, camera.width):
        size_needed = f"({camera.height}, {camera.width}) or with channels"
        raise InputError(f"image: shape {source.shape} given; the camera's is {size_needed}")
    if source.dtype.kind not in "uif":
        raise InputError(f"image: {source.dtype} given; numbers are needed")
    width, height = (int(finite_number("size", s, minimum=1, maximum=_LARGEST_SIDE)) for s in size)
    angle = finite_number("field_of_view", field_of_view, above=0.0)
    if angle >= math.pi:
        raise InputError(f"field_of_view: {angle:g} given; legal: less than π; a plane shows no more")
    focal = 0.5 * width / math.tan(0.5 * angle)
    view = UnifiedCamera(focal, focal, 0.5 * (width - 1), 0.5 * (height - 1), 0.0, width, height)
    camera_R_view = _orientation(direction, up)
    v, u = np.mgrid[0:height, 0:width].astype(np.float64)
    rays = view.unproject(np.stack([u, v], axis=-1))[0].reshape(-1, 3)
    pixels, seen = camera.project(camera_R_view.apply(rays))
    valid = (seen & camera.in_image(pixels)).reshape(height, width)
    return TangentView(
        _resampled(source, pixels.reshape(height, width, 2), valid), valid, view, camera_R_view
    )


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


def _resampled(source: npt.NDArray[Any], pixels: FloatArray, valid: BoolArray) -> npt.NDArray[Any]:
    coordinates = [np.where(valid, pixels[..., 1], 0.0), np.where(valid, pixels[..., 0], 0.0)]
    channels = source[..., None] if source.ndim == 2 else source
    planes = [
        map_coordinates(channels[..., c].astype(np.float64), coordinates, order=1, mode="nearest")
        for c in range(channels.shape[2])
    ]
    view = np.where(valid[..., None], np.stack(planes, axis=-1), 0.0)
    view = np.rint(view) if source.dtype.kind in "ui" else view
    return np.asarray((view[..., 0] if source.ndim == 2 else view).astype(source.dtype))
