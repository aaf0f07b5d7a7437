"""Cameras from files, one file per format, and from corners found in images."""

from omniservo.calibration.adjustment import Calibration, calibrate_camera
from omniservo.calibration.camera_files import FORMATS, load_camera, load_model, save_camera

__all__ = ["FORMATS", "Calibration", "calibrate_camera", "load_camera", "load_model", "save_camera"]
