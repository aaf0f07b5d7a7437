"""Cameras calibrated from images of boards, and eye-in-hand calibration."""

from omniservo.calibration.adjustment import Calibration, calibrate_camera
from omniservo.calibration.boards import board_from_text, find_board
from omniservo.calibration.calibrate_images import ImageCalibration, calibrate_images
from omniservo.calibration.camera_check import CameraCheck, check_camera
from omniservo.renamed import renamed

__all__ = [
    "Calibration",
    "CameraCheck",
    "ImageCalibration",
    "board_from_text",
    "calibrate_camera",
    "calibrate_images",
    "check_camera",
    "find_board",
]

__getattr__ = renamed(
    __name__,
    {
        "FORMATS": "omniservo.camera_files.FORMATS",
        "load_camera": "omniservo.camera_files.load_camera",
        "load_model": "omniservo.camera_files.load_model",
        "save_camera": "omniservo.camera_files.save_camera",
        "closest_model": "omniservo.camera_files.closest_model",
        "named_camera": "omniservo.camera_files.named_camera",
        "named_model": "omniservo.camera_files.named_model",
    },
)
