"""Cameras that are at hand without a calibration file."""

from __future__ import annotations

import math
from collections.abc import Mapping
from types import MappingProxyType

from omniservo.cameras.dead_zone import DeadZone
from omniservo.cameras.unified_camera import UnifiedCamera
from omniservo.errors import InputError

PRESETS: Mapping[str, UnifiedCamera] = MappingProxyType(
    {
        # the paper's lens FE185, ξ and K of its section 4; 185° of view
        "fe185": UnifiedCamera(
            296.9365, 298.4197, 316.8076, 254.9012, 1.2910, 659, 432, max_angle=math.radians(92.5)
        ),
        "perspective": UnifiedCamera(420.0, 420.0, 319.5, 239.5, 0.0, 640, 480),
        # parabolic mirror under a telecentric lens; the lens sees itself in the middle, a little off axis
        "para-catadioptric": UnifiedCamera(
            338.0,
            338.5,
            641.9,
            515.2,
            1.0,
            1280,
            1024,
            max_angle=math.radians(101.0),
            dead_zone=DeadZone((645.0, 512.0), 58.0),
        ),
        # hyperbolic mirror; fx < 0 because a mirror reflects, so that the world stays right-handed
        "hyper-catadioptric": UnifiedCamera(
            -231.4,
            230.9,
            508.6,
            386.3,
            0.9,
            1024,
            768,
            max_angle=math.radians(105.0),
            dead_zone=DeadZone((511.0, 384.5), 46.0),
        ),
    }
)
"""Name → camera: the paper's fisheye, a perspective camera, and two mirrors with dead zones."""


def preset(name: str) -> UnifiedCamera:
    """Return the camera of this name.

    Raises:
        InputError: no such preset.
    """
    if name not in PRESETS:
        raise InputError(f"preset: {name!r} given; legal: {', '.join(PRESETS)}")
    return PRESETS[name]
