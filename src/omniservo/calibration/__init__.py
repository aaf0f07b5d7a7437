"""Cameras from files, one file per format, and from pictures of boards."""

from omniservo.calibration.adjustment import Calibration, calibrate_camera
from omniservo.calibration.boards import board_from_text, find_board
from omniservo.calibration.calibrate_images import ImageCalibration, calibrate_images
from omniservo.calibration.camera_files import FORMATS, load_camera, load_model, save_camera
from omniservo.calibration.closest_model import closest_model
from omniservo.calibration.named_camera import named_camera, named_model

__all__ = [
    "FORMATS",
    "Calibration",
    "ImageCalibration",
    "board_from_text",
    "calibrate_camera",
    "calibrate_images",
    "closest_model",
    "find_board",
    "load_camera",
    "load_model",
    "named_camera",
    "named_model",
    "save_camera",
]
