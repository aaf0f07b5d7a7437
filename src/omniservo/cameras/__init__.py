"""The unified camera: pixels to bearings and back, its domain, its image limits as cones."""

from omniservo.cameras.dead_zone import DeadZone
from omniservo.cameras.image_limits import ImageLimits
from omniservo.cameras.model_error import ModelError
from omniservo.cameras.polygon_shortfall import polygon_shortfall
from omniservo.cameras.presets import PRESETS, preset
from omniservo.cameras.rectify import (
    RectifiedView,
    cylindrical_view,
    equirectangular_view,
    perspective_view,
    rectify,
    tangent_view,
)
from omniservo.cameras.unified_camera import UnifiedCamera
from omniservo.cameras.virtual_plane import from_virtual_plane, to_virtual_plane

__all__ = [
    "PRESETS",
    "DeadZone",
    "ImageLimits",
    "ModelError",
    "RectifiedView",
    "UnifiedCamera",
    "cylindrical_view",
    "equirectangular_view",
    "from_virtual_plane",
    "perspective_view",
    "polygon_shortfall",
    "preset",
    "rectify",
    "tangent_view",
    "to_virtual_plane",
]
