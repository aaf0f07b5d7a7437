"""What a camera's parameters do to its pixels, and through them to an estimate."""

from __future__ import annotations

from typing import Any

import numpy as np
import numpy.typing as npt

from omniservo.cameras import UnifiedCamera
from omniservo.errors import InputError
from omniservo.geometry.arrays import FloatArray, finite_array

PARAMETERS = ("fx", "fy", "cx", "cy", "xi", "k1", "k2", "p1", "p2")
"""In the order of `Calibration.covariance`, which ends with xi where there is no distortion."""

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


def calibration_directions(covariance: npt.ArrayLike) -> FloatArray:
    """Return independent directions (q, p) of the camera's parameters, one σ each: Σ dᵀd is the covariance.

    Raises:
        InputError: not (5, 5) or (9, 9), not symmetric, or with a negative eigenvalue.
    """
    matrix = finite_array("calibration_covariance", covariance, (None, None))
    if matrix.shape not in ((5, 5), (9, 9)):
        raise InputError(
            f"calibration_covariance: shape {matrix.shape} given; legal: (5, 5) of fx, fy, cx, cy, xi, or"
            " (9, 9) with k1, k2, p1, p2"
        )
    scale = np.sqrt(np.maximum(np.diag(matrix), 0.0))
    units = np.where(scale > 0.0, scale, 1.0)
    even = matrix / np.outer(units, units)
    values, vectors = np.linalg.eigh(0.5 * (even + even.T))
    if np.abs(even - even.T).max() > 1e-6 or values[0] < -1e-6:
        raise InputError("calibration_covariance: a symmetric matrix without negative eigenvalues is needed")
    kept = values > 1e-12 * max(values[-1], 1e-300)
    return np.ascontiguousarray((vectors[:, kept] * np.sqrt(values[kept])).T * units)


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
