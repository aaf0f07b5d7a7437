"""Cameras that are at hand without a calibration file."""

import math

from omniservo.cameras.unified_camera import UnifiedCamera

PRESETS = {
    "fe185": UnifiedCamera(
        296.9365, 298.4197, 316.8076, 254.9012, 1.2910, 659, 432, max_angle=math.radians(92.5)
    ),
    "perspective": UnifiedCamera(420.0, 420.0, 319.5, 239.5, 0.0, 640, 480),
}


def preset(name: str) -> UnifiedCamera:
    """Return a preset."""
    return PRESETS[name]
