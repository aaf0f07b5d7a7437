"""Reading and writing cameras: one file per format."""

from omniservo.calibration.camera_files import FORMATS, load_camera, load_model, save_camera

__all__ = ["FORMATS", "load_camera", "load_model", "save_camera"]
