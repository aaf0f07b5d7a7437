"""The arm (kinematics, limits) and the protocol that every robot, real or simulated, implements."""

from omniservo.robots.arm import Arm
from omniservo.robots.arm_files import SHOWN_GROUP
from omniservo.robots.follow_path import FollowedPath, follow_path
from omniservo.robots.joint_path import JointPath, PathFailure
from omniservo.robots.link import Link, Shape
from omniservo.robots.load_arm import load_arm, shipped_arms
from omniservo.robots.robot import CameraImage, Robot, RobotState

__all__ = [
    "SHOWN_GROUP",
    "Arm",
    "CameraImage",
    "FollowedPath",
    "JointPath",
    "Link",
    "PathFailure",
    "Robot",
    "RobotState",
    "Shape",
    "follow_path",
    "load_arm",
    "shipped_arms",
]
