"""Perspective views that cover a wide-angle camera's field, as maps that resample its image fast."""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache
from typing import Any

import cv2
import numpy as np
import numpy.typing as npt
from scipy.spatial.transform import Rotation

from omniservo.cameras import UnifiedCamera, perspective_view
from omniservo.cameras.models.central_model import CentralModel
from omniservo.cameras.widest_angle import widest_angle
from omniservo.geometry.arrays import ByteArray, FloatArray

_FIELD = np.deg2rad(84.0)
"""of a view: at its border squares are stretched twice"""
_APART = np.deg2rad(56.0)
"""between neighbouring views: a tag smaller than the overlap is whole in one"""
_NARROW = np.deg2rad(42.0)
"""a camera that sees no farther from its axis needs no views"""
_FINER = 1.2
"""pixels of a view for a pixel of the image, in the view's middle"""
_LARGEST_SIDE = 1600
_LEAST_SEEN = 0.03


@dataclass(frozen=True, eq=False)
class TagView:
    """One view of a camera's field."""

    camera: UnifiedCamera
    """the perspective camera that has taken it"""
    camera_R_view: FloatArray
    """(3, 3) turns directions in the view's frame into those in the camera frame"""
    maps: tuple[npt.NDArray[np.float32], npt.NDArray[np.float32]]
    """pixel u and v of the image for each pixel of the view, far outside where there is none"""

    def resampled(self, image: ByteArray) -> ByteArray:
        """Return the image as the view sees it, 0 where the camera sees nothing."""
        return np.asarray(cv2.remap(image, *self.maps, cv2.INTER_LINEAR, borderMode=cv2.BORDER_CONSTANT))

    def bearings(self, pixels: FloatArray) -> FloatArray:
        """Return bearings (…, 3) in the camera frame of pixels (…, 2) of the view."""
        rays, _ = self.camera.unproject(pixels)
        return np.asarray(rays @ self.camera_R_view.T)


def field_views(camera: CentralModel) -> tuple[TagView, ...]:
    """Return views that cover all that the camera sees; none for a camera with a narrow field."""
    hashable: Any = camera
    return _field_views(hashable)


@lru_cache(maxsize=4)
def _field_views(camera: Any) -> tuple[TagView, ...]:
    widest = widest_angle(camera)
    if widest <= _NARROW:
        return ()
    views = [view_towards(camera, np.array([0.0, 0.0, 1.0]), _FIELD)]
    rings = int(np.ceil((widest - 0.5 * _FIELD) / _APART))
    for ring in range(1, rings + 1):
        angle = min(ring * _APART, np.pi)
        count = max(1, int(np.ceil(2.0 * np.pi * np.sin(angle) / _APART)))
        for turn in 2.0 * np.pi * (np.arange(count) + 0.5 * ring) / count:
            side = np.array([np.cos(turn), np.sin(turn)]) * np.sin(angle)
            views.append(view_towards(camera, np.append(side, np.cos(angle)), _FIELD))
    return tuple(view for view in views if view is not None)


def view_towards(camera: CentralModel, direction: FloatArray, field: float) -> TagView | None:
    """Return the square view in a direction, or None where the camera sees next to nothing of it.

    Args:
        camera: the camera that takes the images.
        direction: (3,) the view's axis, of length 1, camera frame.
        field: of view, between opposite sides [rad].
    """
    frame = _frame(direction)
    scale = _scale(camera, frame, 0.5 * field)
    side = int(np.clip(2.0 * _FINER * scale * np.tan(0.5 * field), 32, _LARGEST_SIDE))
    view = perspective_view(field, (side, side))
    v, u = np.mgrid[0:side, 0:side].astype(np.float64)
    pixels, valid = camera.project(view.unproject(np.stack([u, v], axis=-1))[0] @ frame.T)
    valid &= camera.in_image(np.where(valid[..., None], pixels, -1e6))
    if valid.mean() < _LEAST_SEEN:
        return None
    maps = np.where(valid[..., None], pixels, -100.0).astype(np.float32)
    return TagView(view, frame, (np.ascontiguousarray(maps[..., 0]), np.ascontiguousarray(maps[..., 1])))


def _frame(direction: FloatArray) -> FloatArray:
    """Columns x, y, z of a view: the shortest turn from the camera's axis."""
    axis = np.cross([0.0, 0.0, 1.0], direction)
    sine = float(np.linalg.norm(axis))
    angle = float(np.arctan2(sine, direction[2]))
    axis = axis / sine if sine > 1e-9 else np.array([1.0, 0.0, 0.0])
    return np.asarray(Rotation.from_rotvec(angle * axis).as_matrix())


def _scale(camera: CentralModel, frame: FloatArray, reach: float) -> float:
    """Pixels for a radian, the larger way, at the visible places nearest the view's axis; 0 for none."""
    for away in np.linspace(0.0, 1.2 * reach, 7):
        turns = np.linspace(0.0, 2.0 * np.pi, 1 if away == 0 else 12, endpoint=False)
        rays = np.stack(
            [np.sin(away) * np.cos(turns), np.sin(away) * np.sin(turns), np.full(len(turns), np.cos(away))], 1
        )
        step = 1e-3
        around = [rays, rays + np.array([step, 0.0, 0.0]), rays + np.array([0.0, step, 0.0])]
        pixels, valid = camera.project(np.stack(around) @ frame.T)
        good = valid.all(axis=0) & camera.in_image(np.where(valid[0][:, None], pixels[0], -1e6))
        if good.any():
            steps = np.stack([pixels[1] - pixels[0], pixels[2] - pixels[0]], axis=2)[good] / step
            return float(np.linalg.norm(steps, 2, axis=(1, 2)).max())
    return 0.0
