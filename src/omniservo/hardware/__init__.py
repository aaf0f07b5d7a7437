"""Real arms and cameras: their adapters, their clocks, the file that names them."""

from omniservo.hardware.arm_connection import ArmConnection
from omniservo.hardware.clock_map import ClockMap
from omniservo.hardware.joint_history import JointHistory
from omniservo.hardware.link_faults import FaultyLine, LinkFaults
from omniservo.hardware.open_arm import ArmAddress

__all__ = ["ArmAddress", "ArmConnection", "ClockMap", "FaultyLine", "JointHistory", "LinkFaults"]
