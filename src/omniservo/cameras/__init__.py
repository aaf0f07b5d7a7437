"""The unified camera: pixels to bearings and back, its domain, its image limits as cones."""

from omniservo.cameras.dead_zone import DeadZone
from omniservo.cameras.image_limits import ImageLimits
from omniservo.cameras.presets import PRESETS, preset
from omniservo.cameras.unified_camera import UnifiedCamera

__all__ = ["PRESETS", "DeadZone", "ImageLimits", "UnifiedCamera", "preset"]
