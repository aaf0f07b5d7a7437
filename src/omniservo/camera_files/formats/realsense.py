"""What ``rs-enumerate-devices -c`` prints of a RealSense camera: its streams in every resolution.

Width, Height, PPX, PPY, Fx, Fy, and five numbers by what Distortion says: None; Brown Conrady, Inverse Brown
Conrady and Modified Brown Conrady (k1, k2, p1, p2, k3), taken as OpenCV's as the ROS driver does;
Kannala Brandt4 (k1…k4). (0, 0) is a pixel's centre. Source: librealsense's page on projection and its
``rsutil.h``, whose formula of the last two of Brown and Conrady differs from OpenCV's by the product of the
radial and the tangential part: some hundredths of a pixel. Read only.
"""

from __future__ import annotations

from typing import Any

from omniservo.camera_files.calibration_file import CalibrationFile
from omniservo.camera_files.document import STREAMS
from omniservo.cameras.models import CentralModel, KannalaBrandt, Pinhole

_RADTAN = ("Brown Conrady", "Inverse Brown Conrady", "Modified Brown Conrady")
_FISHEYE = ("Kannala Brandt4",)


def recognises(fields: Any) -> bool:
    """Say whether the fields are a RealSense camera's streams."""
    return STREAMS in fields


def names(file: CalibrationFile) -> list[str]:
    """Return the streams with their resolution: Color-640x480."""
    return list(file.fields[STREAMS])


def read(file: CalibrationFile, name: str) -> CentralModel:
    """Return the camera of this stream.

    Raises:
        InputError: printed several times with other numbers, another distortion, or a field is missing or not
            legal.
    """
    at = (STREAMS, name)
    if isinstance(file.value(*at), list):
        raise file.error(
            "printed several times with other numbers, of several cameras or formats; keep the one you mean",
            *at,
        )
    kind = file.word((*_RADTAN, *_FISHEYE, "None"), *at, "Distortion")
    given: dict[str, Any] = {
        ours: file.number(*at, theirs, nonzero=theirs[0] == "F")
        for ours, theirs in (("fx", "Fx"), ("fy", "Fy"), ("cx", "PPX"), ("cy", "PPY"))
    }
    sides = tuple(file.number(*at, side, minimum=1.0) for side in ("Width", "Height"))
    given |= file.image_size(sides, *at, "Width")
    five = file.numbers(5, *at, "Coeffs")
    if kind in _FISHEYE:
        return file.build(KannalaBrandt, **given, k=five[:4])
    return file.build(Pinhole, **given, distortion=five if any(five) and kind in _RADTAN else ())
