"""The arm (kinematics, limits) and the protocol that every robot, real or simulated, implements."""

from omniservo.robots.arm import Arm
from omniservo.robots.robot import CameraImage, Robot, RobotState

__all__ = ["Arm", "CameraImage", "Robot", "RobotState"]
