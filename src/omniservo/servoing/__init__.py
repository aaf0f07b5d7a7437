"""Features with their interaction matrices, control law and time laws."""

from omniservo.servoing.adaptive_gain import AdaptiveGain
from omniservo.servoing.control_law import camera_twist, limited_twist
from omniservo.servoing.even_pace_law import EvenPaceLaw
from omniservo.servoing.features import (
    BearingFeatures,
    Feature,
    FeatureName,
    VirtualPlaneFeatures,
    feature_named,
)
from omniservo.servoing.feedback import feedback
from omniservo.servoing.hybrid_servo import HybridServo, HybridServoOptions
from omniservo.servoing.image_servo import ImageServo, ImageServoOptions
from omniservo.servoing.image_speed import image_speed
from omniservo.servoing.measured_pose import MeasuredPose
from omniservo.servoing.path_limits import PathLimits
from omniservo.servoing.paused_law import Pause, PausedLaw
from omniservo.servoing.pose_servo import PoseServo, PoseServoOptions
from omniservo.servoing.rest_of_law import RestOfLaw
from omniservo.servoing.servo_measurement import ServoMeasurement
from omniservo.servoing.servo_method import ServoMethod
from omniservo.servoing.servo_methods import SERVO_METHODS, servo_method
from omniservo.servoing.spherical_servo import SphericalServo, SphericalServoOptions
from omniservo.servoing.switched_servo import SwitchedServo, SwitchedServoOptions
from omniservo.servoing.time_law import ExponentialLaw, RestToRestLaw, TimeLaw
from omniservo.servoing.time_optimal_law import TimeOptimalLaw

__all__ = [
    "SERVO_METHODS",
    "AdaptiveGain",
    "BearingFeatures",
    "EvenPaceLaw",
    "ExponentialLaw",
    "Feature",
    "FeatureName",
    "HybridServo",
    "HybridServoOptions",
    "ImageServo",
    "ImageServoOptions",
    "MeasuredPose",
    "PathLimits",
    "Pause",
    "PausedLaw",
    "PoseServo",
    "PoseServoOptions",
    "RestOfLaw",
    "RestToRestLaw",
    "ServoMeasurement",
    "ServoMethod",
    "SphericalServo",
    "SphericalServoOptions",
    "SwitchedServo",
    "SwitchedServoOptions",
    "TimeLaw",
    "TimeOptimalLaw",
    "VirtualPlaneFeatures",
    "camera_twist",
    "feature_named",
    "feedback",
    "image_speed",
    "limited_twist",
    "servo_method",
]
