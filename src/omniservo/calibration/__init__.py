"""Cameras from files, one file per format, and from corners found in images."""

from omniservo.calibration.adjustment import Calibration, calibrate_camera
from omniservo.calibration.camera_files import FORMATS, load_camera, load_model, save_camera
from omniservo.calibration.closest_model import closest_model

__all__ = [
    "FORMATS",
    "Calibration",
    "calibrate_camera",
    "closest_model",
    "load_camera",
    "load_model",
    "save_camera",
]
