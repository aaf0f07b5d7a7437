"""Arms of Universal Robots by Real-Time Data Exchange: the client, and a stand-in for the controller."""

from omniservo.hardware.rtde.rtde_arm import UR_JOINTS, RtdeArm

__all__ = ["UR_JOINTS", "RtdeArm"]
