"""ROS 2's messages as plain values, their bytes (CDR) and their definitions as text, without ROS."""

from omniservo.ros_messages.cdr import decode, encode
from omniservo.ros_messages.definition import definition
from omniservo.ros_messages.messages import RosMessage

__all__ = ["RosMessage", "decode", "definition", "encode"]
