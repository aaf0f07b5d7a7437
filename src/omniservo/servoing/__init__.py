"""Features with their interaction matrices, control law and time laws."""

from omniservo.servoing.control_law import camera_twist, limited_twist
from omniservo.servoing.features import (
    BearingFeatures,
    Feature,
    FeatureName,
    VirtualPlaneFeatures,
    feature_named,
)
from omniservo.servoing.image_servo import ImageServo, ImageServoOptions, ImageServoReport
from omniservo.servoing.time_law import ExponentialLaw, RestToRestLaw, TimeLaw

__all__ = [
    "BearingFeatures",
    "ExponentialLaw",
    "Feature",
    "FeatureName",
    "ImageServo",
    "ImageServoOptions",
    "ImageServoReport",
    "RestToRestLaw",
    "TimeLaw",
    "VirtualPlaneFeatures",
    "camera_twist",
    "feature_named",
    "limited_twist",
]
