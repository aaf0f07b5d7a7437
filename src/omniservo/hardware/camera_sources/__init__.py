"""Cameras: of this machine, of the network, recorded ones; by their URI."""

from omniservo.hardware.camera_sources.newest_frame import NewestFrame
from omniservo.hardware.camera_sources.open_camera import open_camera

__all__ = ["NewestFrame", "open_camera"]
