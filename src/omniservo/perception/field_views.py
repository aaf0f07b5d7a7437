"""Perspective views that together cover what a camera sees, each of the image's own resolution."""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import lru_cache

import cv2
import numpy as np
import numpy.typing as npt

from omniservo.cameras.models import CentralModel
from omniservo.cameras.widest_angle import widest_angle
from omniservo.geometry.arrays import BoolArray, ByteArray, FloatArray
from omniservo.perception.tangent_patches import TangentFrames

RINGS = ((0.0, 1), (45.0, 6), (90.0, 9), (135.0, 6), (180.0, 1))
"""(angle from the axis [deg], count) of the views: no direction is farther than 31.5° from one of them"""
REACH = math.radians(31.5)
ROOM = 40
"""[px] that a view shows beyond its own directions, for the descriptors there"""
LARGEST_HALF = 1000
"""[px] half the side of a view"""


@dataclass(frozen=True, eq=False)
class FieldView:
    """A perspective view of the directions nearest to its axis, cut to what the camera sees of them."""

    frame: TangentFrames
    """of its one plane"""
    focal: float
    """[px] of the view"""
    corner: FloatArray
    """(2,) [px] of its first pixel from the plane's point"""
    maps: npt.NDArray[np.float32]
    """(h, w, 2) [px] of the image"""
    nearest_seen: npt.NDArray[np.int64]
    """(h, w) index, row by row, of the nearest pixel of the view that the image shows: often itself"""
    room: npt.NDArray[np.float32]
    """(h, w) [px] distance to what the image does not show; 0 there"""
    own: BoolArray
    """(h, w) whether no other view's axis is nearer"""

    def image(self, image: ByteArray) -> ByteArray:
        """The view of an image, cubic; where the image shows nothing, the nearest grey that it shows."""
        grey = cv2.remap(
            image, self.maps[..., 0], self.maps[..., 1], cv2.INTER_CUBIC, borderMode=cv2.BORDER_REPLICATE
        )
        return np.asarray(grey.ravel()[self.nearest_seen])

    def places(self, pixels: FloatArray) -> FloatArray:
        """Places (n, 2) on the plane of the view's pixels (n, 2)."""
        return np.asarray((pixels + self.corner) / self.focal)


@lru_cache(maxsize=2)
def field_views(camera: CentralModel) -> tuple[FieldView, ...]:
    """The views, kept for the camera's next image: every direction that it sees is one's own."""
    axes = _axes()
    v, u = np.mgrid[0 : camera.height : 8, 0 : camera.width : 8].astype(np.float64)
    pixels = np.stack([u.ravel(), v.ravel()], axis=1)
    bearings, valid = camera.unproject(pixels)
    valid &= camera.in_image(pixels)
    bearings = bearings[valid]
    nearest = np.argmax(bearings @ axes.T, axis=1)
    largest = LARGEST_HALF / max(math.tan(min(REACH, widest_angle(camera))), 1e-9)
    return tuple(_view(camera, axes, int(i), bearings[nearest == i], largest) for i in np.unique(nearest))


def _axes() -> FloatArray:
    """The views' axes (v, 3)."""
    rings = []
    for angle, count in RINGS:
        turn = 2.0 * math.pi * (np.arange(count) + 0.5) / count
        sine, cosine = math.sin(math.radians(angle)), math.cos(math.radians(angle))
        rings.append(np.stack([sine * np.cos(turn), sine * np.sin(turn), np.full(count, cosine)], axis=1))
    return np.concatenate(rings)


def _view(
    camera: CentralModel, axes: FloatArray, index: int, bearings: FloatArray, largest: float
) -> FieldView:
    """The view along one axis, as large as the ``bearings`` (k, 3) that it must show need.

    Its focal length is the image's resolution there, at most ``largest`` [px].
    """
    frame = TangentFrames.at(axes[index : index + 1])
    jacobians = TangentFrames.at(bearings).jacobians(camera)
    resolution = np.linalg.norm(jacobians[np.isfinite(jacobians).all((1, 2))], ord=2, axis=(1, 2))
    focal = float(np.clip(np.median(resolution), 16.0, largest)) if len(resolution) else 16.0
    shown = focal * TangentFrames(
        np.repeat(frame.bearings, len(bearings), axis=0), np.repeat(frame.first, len(bearings), axis=0)
    ).places(bearings)
    low, high = np.floor(shown.min(0)) - ROOM, np.ceil(shown.max(0)) + ROOM
    y, x = np.mgrid[low[1] : high[1] + 1.0, low[0] : high[0] + 1.0]
    directions = frame.directions(np.stack([x, y], axis=-1)[None] / focal)[0]
    maps = camera.project(directions)[0]
    seen = camera.in_image(maps)
    _, labels = cv2.distanceTransformWithLabels(
        (~seen).astype(np.uint8), cv2.DIST_L2, cv2.DIST_MASK_5, labelType=cv2.DIST_LABEL_PIXEL
    )
    place = np.zeros(int(labels.max()) + 1, dtype=np.int64)
    place[labels[seen]] = np.flatnonzero(seen)
    room = cv2.distanceTransform(
        np.pad(seen, 1, mode="constant").astype(np.uint8), cv2.DIST_L2, cv2.DIST_MASK_PRECISE
    )[1:-1, 1:-1]
    own = np.argmax(directions @ axes.T, axis=-1) == index
    return FieldView(frame, focal, low, maps.astype(np.float32), place[labels], room, own)
