"""Where the camera sits on the flange: from robot poses and images of a board that stands still."""

from omniservo.calibration.hand_eye.calibrate_hand_eye import calibrate_hand_eye
from omniservo.calibration.hand_eye.calibrate_images import ImageHandEye, calibrate_hand_eye_images
from omniservo.calibration.hand_eye.hand_eye import HandEye, HandEyeView, load_hand_eye, load_robot_sigmas
from omniservo.calibration.hand_eye.robot_poses_file import RobotPoses, load_robot_poses

__all__ = [
    "HandEye",
    "HandEyeView",
    "ImageHandEye",
    "RobotPoses",
    "calibrate_hand_eye",
    "calibrate_hand_eye_images",
    "load_hand_eye",
    "load_robot_poses",
    "load_robot_sigmas",
]
