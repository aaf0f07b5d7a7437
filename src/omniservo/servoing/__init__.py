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
from omniservo.servoing.image_speed import image_speed
from omniservo.servoing.measured_pose import MeasuredPose
from omniservo.servoing.path_limits import PathLimits
from omniservo.servoing.paused_law import Pause, PausedLaw
from omniservo.servoing.rest_of_law import RestOfLaw
from omniservo.servoing.time_law import ExponentialLaw, RestToRestLaw, TimeLaw
from omniservo.servoing.time_optimal_law import TimeOptimalLaw

__all__ = [
    "BearingFeatures",
    "ExponentialLaw",
    "Feature",
    "FeatureName",
    "ImageServo",
    "ImageServoOptions",
    "ImageServoReport",
    "MeasuredPose",
    "PathLimits",
    "Pause",
    "PausedLaw",
    "RestOfLaw",
    "RestToRestLaw",
    "TimeLaw",
    "TimeOptimalLaw",
    "VirtualPlaneFeatures",
    "camera_twist",
    "feature_named",
    "image_speed",
    "limited_twist",
]
