"""How far a pixel is from where the camera stops seeing."""

from __future__ import annotations

import math

import numpy as np
from scipy.spatial import cKDTree

from omniservo.cameras import UnifiedCamera
from omniservo.cameras.image_mask import distance_beyond
from omniservo.cameras.model_domain import radius_of_angle
from omniservo.cameras.models import CentralModel
from omniservo.geometry.arrays import FloatArray

_ROUND = 1441


def image_distance(camera: CentralModel, pixels: FloatArray) -> FloatArray:
    """Return each pixel's distance to the nearest image limit [px]; negative outside.

    The limits are those that visibility margins are stated for: the edges at −½, W−½, −½, H−½; the circle
    of the largest angle, for a unified camera at (r(θ_max) − r)·σ with r the radius on the normalised plane
    before distortion, r(θ) = sin θ/(cos θ + ξ), past the model's domain its rim, and σ the smallest singular
    value of K's upper left 2×2 block, for another where the image has it; the dead zone; the mask, so far as
    its edges can move outward.

    Args:
        camera: of any model.
        pixels: (…, 2) [px].

    Returns:
        (…,) [px]; NaN where the pixel is NaN or beyond what the camera can unproject.
    """
    u, v = pixels[..., 0], pixels[..., 1]
    distances = [u + 0.5, camera.width - 0.5 - u, v + 0.5, camera.height - 0.5 - v]
    if camera.max_angle is not None:
        distances.append(_to_rim(camera, camera.max_angle, pixels))
    if camera.dead_zone is not None:
        centre_u, centre_v = camera.dead_zone.center
        distances.append(np.hypot(u - centre_u, v - centre_v) - camera.dead_zone.radius)
    if camera.mask:
        distances.append(distance_beyond(camera.mask, pixels))
    return np.asarray(np.min(np.stack(distances), axis=0), dtype=np.float64)


def _to_rim(camera: CentralModel, angle: float, pixels: FloatArray) -> FloatArray:
    """Return the distances (…,) [px] to the circle at ``angle`` [rad]; NaN outside the domain."""
    bearings, valid = camera.unproject(pixels)
    if isinstance(camera, UnifiedCamera):
        across = np.hypot(bearings[..., 0], bearings[..., 1])
        radius = across / (bearings[..., 2] + camera.xi)
        largest = radius_of_angle(camera.xi, angle)
        scale = np.linalg.svd(camera.matrix[:2, :2], compute_uv=False)[-1]
        return np.asarray((largest - radius) * scale)
    around = np.linspace(0.0, 2.0 * np.pi, _ROUND)
    across = math.sin(angle) * np.stack([np.cos(around), np.sin(around)], axis=1)
    rim, seen = camera.project(np.column_stack([across, np.full(_ROUND, math.cos(angle))]))
    if not seen.any():
        return np.where(valid, np.inf, np.nan)
    gaps = cKDTree(rim[seen]).query(np.where(valid[..., None], pixels, 0.0))[0]
    return np.where(valid, gaps, np.nan)
