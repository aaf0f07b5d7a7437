"""MJCF and URDF files of arms: checked as untrusted input, then read by MuJoCo."""

from omniservo.robots.arm_files.arm_model import SHOWN_GROUP, ArmModel
from omniservo.robots.arm_files.read_arm_file import read_arm_file

__all__ = ["SHOWN_GROUP", "ArmModel", "read_arm_file"]
