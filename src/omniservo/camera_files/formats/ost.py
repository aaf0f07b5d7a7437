"""``ost.txt``, which ROS's camera_calibration writes beside its ``ost.yaml``.

A section ``[image]`` with width and height, then one for each camera, which has its name: camera matrix
(3 × 3), distortion, rectification and projection, each above its values, which have six decimals. Camera
matrix and distortion are read, as of CameraInfo. Five or eight numbers are OpenCV's k1, k2, p1, p2, k3, …;
four may be a fisheye's k1…k4 or a pinhole's k1, k2, p1, p2, so the caller says which. (0, 0) is a pixel's
centre. Source: camera_calibration's calibrator.py, which writes it. Read only.
"""

from __future__ import annotations

from typing import Any

from omniservo.camera_files.calibration_file import CalibrationFile
from omniservo.camera_files.document import OST
from omniservo.cameras.models import CentralModel, KannalaBrandt, Pinhole


def recognises(fields: Any) -> bool:
    """Say whether the fields are those of an ost.txt."""
    return OST in fields


def names(file: CalibrationFile) -> list[str]:
    """Return the names of the cameras: narrow_stereo, or narrow_stereo/left and narrow_stereo/right."""
    return list(file.fields[OST])


def read(file: CalibrationFile, name: str) -> CentralModel:
    """Return the camera of this name.

    Raises:
        InputError: a field is missing or not legal, or four numbers may be a fisheye's or a pinhole's.
    """
    at = (OST, name)
    given: dict[str, Any] = file.intrinsics(*at, "camera matrix")
    sides = [file.numbers(1, *at, side)[0] for side in ("width", "height")]
    given |= file.image_size(tuple(sides), *at, "width")
    distortion = file.coefficients(*at, "distortion", legal=(0, 4, 5, 8, 12, 14))
    if len(distortion) == 4 and file.stated_fisheye(*at, "distortion"):
        return file.build(KannalaBrandt, **given, k=distortion)
    return file.build(Pinhole, **given, distortion=distortion)
