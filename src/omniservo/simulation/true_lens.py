"""The lens that images are truly taken through, whatever its user is given."""

from __future__ import annotations

import numpy as np

from omniservo.cameras.image_mask import distance_beyond
from omniservo.geometry.arrays import BoolArray, FloatArray
from omniservo.scenes import Scene


class TrueLens:
    """From pixels to what they see: the scene's true camera, displaced by its lens error.

    Args:
        scene: dead zone and mask, in which a camera sees itself, are those of its `camera`.
    """

    def __init__(self, scene: Scene) -> None:
        self._model = scene.camera if scene.true_camera is None else scene.true_camera
        self._error, self._told = scene.lens_error, scene.camera

    def unproject(self, pixels: FloatArray) -> tuple[FloatArray, BoolArray]:
        """Return bearings (…, 3) of pixels (…, 2), and which of them see anything."""
        return self._model.unproject(pixels if self._error is None else pixels - self._error.at(pixels))

    def sightlines(self, pixels: FloatArray) -> tuple[FloatArray, BoolArray]:
        """Return bearings (…, 3) of pixels (…, 2), and which of them see the world, not the camera itself."""
        bearings, valid = self.unproject(pixels)
        zone = self._told.dead_zone
        if zone is not None:
            offsets = pixels - np.asarray(zone.center)
            valid = valid & ((offsets**2).sum(axis=-1) > zone.radius**2)
        if self._told.mask:
            valid = valid & (distance_beyond(self._told.mask, pixels) > 0.0)
        return bearings, valid

    def slope(self, pixels: FloatArray, step: list[float]) -> FloatArray:
        """Return the change of bearings (…, 3) over twice a step [px]; 0 where one side sees nothing."""
        ahead, ahead_valid = self.unproject(pixels + step)
        behind, behind_valid = self.unproject(pixels - step)
        return np.where((ahead_valid & behind_valid)[..., None], ahead - behind, 0.0)
