"""How far from its axis a camera sees."""

from __future__ import annotations

from functools import lru_cache

import numpy as np

from omniservo.cameras.models import CentralModel


@lru_cache(maxsize=64)
def widest_angle(camera: CentralModel) -> float:
    """Return the largest angle from the axis of anything in the image [rad], on a grid of 60 × 60 pixels."""
    u, v = np.meshgrid(np.linspace(0, camera.width - 1, 60), np.linspace(0, camera.height - 1, 60))
    pixels = np.stack([u, v], axis=-1)
    bearings, valid = camera.unproject(pixels)
    valid &= camera.in_image(pixels)
    return float(np.arccos(np.clip(bearings[valid][:, 2].min(initial=1.0), -1.0, 1.0)))
