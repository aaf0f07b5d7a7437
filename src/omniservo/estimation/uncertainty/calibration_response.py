"""What a camera's parameters do to its pixels, and through them to an estimate."""

from __future__ import annotations

from typing import Any

import numpy as np
import numpy.typing as npt

from omniservo.cameras import UnifiedCamera
from omniservo.cameras.calibration_covariance import PARAMETERS, covariance_directions
from omniservo.geometry.arrays import FloatArray

STEP = 1e-6
"""Relative step of the differences; absolute for the parameters without unit."""


def pixel_slopes(camera: UnifiedCamera, points: FloatArray, count: int) -> FloatArray:
    """Return ∂π/∂θ (…, 2, count) [px] at camera points (…, 3), θ the first ``count`` of `PARAMETERS`.

    Central differences (forward at ξ = 0); 0 for a point that the camera cannot project.
    """
    slopes = np.zeros((*points.shape[:-1], 2, count))
    for i, name in enumerate(PARAMETERS[:count]):
        step = STEP * (max(abs(camera.fx), abs(camera.fy)) if i < 4 else 1.0)
        down = min(step, camera.xi) if name == "xi" else step
        (after, seen), (before, seen_too) = (
            _changed(camera, name, by).project(points) for by in (step, -down)
        )
        slopes[..., i] = np.where((seen & seen_too)[..., None], (after - before) / (step + down), 0.0)
    return slopes


def calibration_directions(camera: UnifiedCamera, covariance: npt.ArrayLike | None) -> FloatArray:
    """Return independent directions (q, p) of the camera's parameters, one σ each: Σ dᵀd is the covariance.

    ``covariance`` None: the camera's own, and (0, 5) where it states none.

    Raises:
        InputError: not (5, 5) or (9, 9), not symmetric, or with a negative eigenvalue.
    """
    stated = camera.calibration_covariance if covariance is None else covariance
    return np.empty((0, 5)) if stated is None else covariance_directions(stated)


def _changed(camera: UnifiedCamera, name: str, by: float) -> UnifiedCamera:
    """Return the camera with one parameter changed, and without the limits that would not allow it."""
    fields: dict[str, Any] = {n: getattr(camera, n) for n in ("fx", "fy", "cx", "cy", "xi")}
    distortion = list(camera.distortion)
    if name in fields:
        fields[name] += by
    else:
        distortion[PARAMETERS.index(name) - 5] += by
    return UnifiedCamera(
        **fields, width=camera.width, height=camera.height, skew=camera.skew, distortion=tuple(distortion)
    )
