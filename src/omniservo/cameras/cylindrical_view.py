"""An image on an upright cylinder: what panoramas are shown on, up to a whole turn round."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from omniservo.cameras.camera_fields import rows_of
from omniservo.geometry.arrays import BoolArray, FloatArray


@dataclass(frozen=True)
class CylindricalView:
    """u = f λ + (W−1)/2 with λ = atan2(X, Z), v = f Y/‖(X, Z)‖ + (H−1)/2; upright lines stay straight."""

    width: int
    height: int
    focal_length: float
    """f [px], also pixels a radian of longitude"""

    def unproject(self, pixels: npt.ArrayLike) -> tuple[FloatArray, BoolArray]:
        """Return the bearings (…, 3) that pixels (…, 2) [px] see, and valid (…): within half a turn."""
        rows, shape = rows_of("pixels", pixels, 2)
        longitude = (rows[:, 0] - 0.5 * (self.width - 1)) / self.focal_length
        height = (rows[:, 1] - 0.5 * (self.height - 1)) / self.focal_length
        rays = np.stack([np.sin(longitude), height, np.cos(longitude)], axis=-1)
        valid = np.isfinite(height) & (np.abs(longitude) <= math.pi * (1.0 + 1e-12))
        bearings = rays / np.hypot(1.0, height)[..., None]
        bearings = np.where(valid[:, None], bearings, np.nan)
        return bearings.reshape(*shape, 3), valid.reshape(shape)

    def project(self, points: npt.ArrayLike) -> tuple[FloatArray, BoolArray]:
        """Return the pixels (…, 2) [px] of points (…, 3), and valid (…): not on the cylinder's axis."""
        rows, shape = rows_of("points", points, 3)
        with np.errstate(over="ignore"):
            across = np.hypot(rows[:, 0], rows[:, 2])
            valid = np.isfinite(rows).all(axis=1) & (across > 0.0)
            u = self.focal_length * np.arctan2(rows[:, 0], rows[:, 2]) + 0.5 * (self.width - 1)
            v = self.focal_length * rows[:, 1] / np.where(valid, across, 1.0) + 0.5 * (self.height - 1)
        valid &= np.isfinite(v)
        pixels = np.where(valid[:, None], np.stack([u, v], axis=1), np.nan)
        return pixels.reshape(*shape, 2), valid.reshape(shape)
