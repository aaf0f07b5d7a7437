"""A camera and the poses of targets, adjusted together to corners that were found in images."""

from omniservo.calibration.adjustment.calibrate_camera import calibrate_camera
from omniservo.calibration.adjustment.calibration import Calibration, Coverage, Errors
from omniservo.calibration.adjustment.equivalence import Equivalent

__all__ = ["Calibration", "Coverage", "Equivalent", "Errors", "calibrate_camera"]
