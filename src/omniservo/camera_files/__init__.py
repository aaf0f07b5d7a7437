"""Cameras from and to files: every supported calibration format, mask images, presets by name."""

from omniservo.camera_files.camera_files import FORMATS, load_camera, load_model, save_camera
from omniservo.camera_files.closest_model import closest_model
from omniservo.camera_files.named_camera import named_camera, named_model

__all__ = [
    "FORMATS",
    "closest_model",
    "load_camera",
    "load_model",
    "named_camera",
    "named_model",
    "save_camera",
]
