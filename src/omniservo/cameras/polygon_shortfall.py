"""How much of what a distorted camera shows its certified limits leave out."""

from __future__ import annotations

import numpy as np

from omniservo.cameras.domain_warnings import image_grid
from omniservo.cameras.unified_camera import UnifiedCamera

_STEPS = 400
"""pixels sampled along each side of the image; the answer is good to about 0.1%"""


def polygon_shortfall(camera: UnifiedCamera, margin_px: float = 0.0) -> float:
    """Return the share of the true region, by area in the image, that ``image_limits`` leaves out.

    The true region is what the image shows with the margin: pixels [px] at least ``margin_px`` inside the
    image that can be unprojected, within max_angle moved inward. Dead zone and mask are no part of it: they
    are limits of their own. 0 for a camera without distortion, whose limits are exact. Measured on a grid.

    Raises:
        InputError: the margin leaves nothing of the image.
    """
    limits = camera.image_limits(margin_px)
    if limits.polygon is None:
        return 0.0
    pixels = image_grid(camera, _STEPS)
    size = np.array([camera.width, camera.height])
    inside = ((pixels >= margin_px - 0.5) & (pixels <= size - 0.5 - margin_px)).all(axis=1)
    rays, valid = camera.unproject(pixels)
    valid &= inside
    rays = rays[valid]
    if margin_px > 0.0:  # every point of the circle of that radius round the pixel is seen too
        around = np.linspace(0.0, 2.0 * np.pi, 8, endpoint=False)
        offsets = margin_px * np.column_stack([np.cos(around), np.sin(around)])
        near = (pixels[valid][:, None] + offsets).reshape(-1, 2)
        rays = rays[camera.unproject(near)[1].reshape(-1, 8).all(axis=1)]
    kept = (rays @ limits.normals.T <= limits.kappas).all(axis=1)
    return float(1.0 - kept.mean())
