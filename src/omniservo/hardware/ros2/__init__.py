"""ROS 2 without ROS: its messages over DDS, for arms and cameras (`pip install omniservo[ros2]`).

Cameras are in `ros2_camera`, the stand-in for tests and rehearsals in `server`: both load OpenCV, which what
drives an arm does without.
"""

from omniservo.hardware.ros2.commands import TrajectoryCommands, TwistCommands, VelocityCommands
from omniservo.hardware.ros2.network import DdsNetwork
from omniservo.hardware.ros2.ros2_arm import Ros2Arm

__all__ = ["DdsNetwork", "Ros2Arm", "TrajectoryCommands", "TwistCommands", "VelocityCommands"]
