"""Which models are the same camera written differently.

| model | is unified with |
|---|---|
| extended unified, β = 1, α < 1 | ξ = α/(1−α), focal lengths divided by 1 − α |
| extended unified, α = 0 | ξ = 0, the same focal lengths |
| double sphere, ξ = 0, α < 1 | as the first |
| double sphere, α = 0, ξ ≥ 0 | the same ξ and focal lengths |
| pinhole with k1, k2, p1, p2 only | ξ = 0, the same distortion |
"""

from __future__ import annotations

from typing import Any

from omniservo.cameras.models import DoubleSphere, ExtendedUnified, Pinhole
from omniservo.cameras.models.central_model import CentralModel
from omniservo.cameras.unified_camera import UnifiedCamera

_LARGEST_ALPHA = 1.0 - 1e-6
"""ξ = α/(1−α) stays below the largest that the unified camera takes"""


def lens_of(model: CentralModel) -> dict[str, Any]:
    """Return the fields that every camera has: size, max_angle, dead zone, mask, deviation, model error."""
    names = ("width", "height", "max_angle", "dead_zone", "mask", "deviation_px", "model_error")
    return {name: getattr(model, name) for name in names}


def as_unified(model: CentralModel) -> UnifiedCamera | None:
    """Return the unified camera that ``model`` is, or None where there is none."""
    if isinstance(model, UnifiedCamera):
        return model
    if isinstance(model, ExtendedUnified) and (model.beta == 1.0 or model.alpha == 0.0):
        return _sphere(model, 0.0, model.alpha)
    if isinstance(model, DoubleSphere) and model.xi >= 0.0 and 0.0 in (model.xi, model.alpha):
        return _sphere(model, model.xi, model.alpha)
    if isinstance(model, Pinhole) and not any(model.distortion[4:]):
        distortion = model.distortion[:4] or (0.0,) * 4
        K = (model.fx, model.fy, model.cx, model.cy)
        return UnifiedCamera(*K, 0.0, **lens_of(model), skew=model.skew, distortion=distortion)
    return None


def from_unified(camera: UnifiedCamera, kind: type[CentralModel]) -> CentralModel | None:
    """Return the camera of class ``kind`` that the unified camera is, or None where there is none."""
    K, lens = (camera.fx, camera.fy, camera.cx, camera.cy), lens_of(camera)
    if kind is UnifiedCamera:
        return camera
    if kind is Pinhole and camera.xi == 0.0:
        distortion = camera.distortion if camera.is_distorted else ()
        return Pinhole(*K, **lens, distortion=distortion, skew=camera.skew)
    if camera.is_distorted or camera.skew != 0.0:
        return None
    alpha, scale = camera.xi / (1.0 + camera.xi), 1.0 / (1.0 + camera.xi)
    K = (camera.fx * scale, camera.fy * scale, camera.cx, camera.cy)
    if kind is ExtendedUnified:
        return ExtendedUnified(*K, alpha, 1.0, **lens)
    if kind is DoubleSphere:
        return DoubleSphere(*K, 0.0, alpha, **lens)
    return None


def _sphere(model: ExtendedUnified | DoubleSphere, xi: float, alpha: float) -> UnifiedCamera | None:
    """Return the camera of one sphere: ξ itself with α = 0, or ξ = α/(1−α)."""
    if alpha > _LARGEST_ALPHA:
        return None
    fx, fy = model.fx / (1.0 - alpha), model.fy / (1.0 - alpha)
    return UnifiedCamera(fx, fy, model.cx, model.cy, xi + alpha / (1.0 - alpha), **lens_of(model))
