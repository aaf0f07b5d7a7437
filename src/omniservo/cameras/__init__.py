"""The unified camera: pixels to bearings and back, its domain, its image limits as cones."""

from omniservo.cameras.dead_zone import DeadZone
from omniservo.cameras.image_limits import ImageLimits
from omniservo.cameras.presets import PRESETS, preset
from omniservo.cameras.tangent_view import TangentView, tangent_view
from omniservo.cameras.unified_camera import UnifiedCamera
from omniservo.cameras.virtual_plane import from_virtual_plane, to_virtual_plane

__all__ = [
    "PRESETS",
    "DeadZone",
    "ImageLimits",
    "TangentView",
    "UnifiedCamera",
    "from_virtual_plane",
    "preset",
    "tangent_view",
    "to_virtual_plane",
]
