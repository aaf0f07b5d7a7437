"""How far a pixel is from where the camera stops seeing."""

from __future__ import annotations

import math

import numpy as np

from omniservo.cameras import UnifiedCamera
from omniservo.cameras.image_mask import distance_beyond
from omniservo.geometry.arrays import FloatArray


def image_distance(camera: UnifiedCamera, pixels: FloatArray) -> FloatArray:
    """Return each pixel's distance to the nearest image limit [px]; negative outside.

    The limits are those that visibility margins are stated for: the edges at −½, W−½, −½, H−½; the circle
    of the largest angle, at (r(θ_max) − r)·σ with r the radius on the normalised plane before distortion,
    r(θ) = sin θ/(cos θ + ξ), and σ the smallest singular value of K's upper left 2×2 block; the dead zone;
    the mask, so far as its edges can move outward.

    Args:
        camera: the camera.
        pixels: (…, 2) [px].

    Returns:
        (…,) [px]; NaN where the pixel is NaN or beyond what the camera can unproject.
    """
    u, v = pixels[..., 0], pixels[..., 1]
    distances = [u + 0.5, camera.width - 0.5 - u, v + 0.5, camera.height - 0.5 - v]
    if camera.max_angle is not None:
        bearings, _ = camera.unproject(pixels)
        across = np.hypot(bearings[..., 0], bearings[..., 1])
        radius = across / (bearings[..., 2] + camera.xi)
        largest = math.sin(camera.max_angle) / (math.cos(camera.max_angle) + camera.xi)
        distances.append((largest - radius) * np.linalg.svd(camera.matrix[:2, :2], compute_uv=False)[-1])
    if camera.dead_zone is not None:
        centre_u, centre_v = camera.dead_zone.center
        distances.append(np.hypot(u - centre_u, v - centre_v) - camera.dead_zone.radius)
    if camera.mask:
        distances.append(distance_beyond(camera.mask, pixels))
    return np.asarray(np.min(np.stack(distances), axis=0), dtype=np.float64)
