"""mrcal's ``.cameramodel``: a Python dictionary with ``lensmodel``, ``intrinsics`` and ``imagersize``.

LENSMODEL_PINHOLE and LENSMODEL_OPENCV4, 5, 8 and 12 are OpenCV's pinhole with so many numbers, after fx, fy,
cx, cy; CAHVOR and splined models are not read. (0, 0) is a pixel's centre. Source: mrcal's manual, "Camera
model" and "Lens models". Read only.
"""

from __future__ import annotations

from typing import Any

from omniservo.camera_files.calibration_file import CalibrationFile
from omniservo.camera_files.document import MRCAL
from omniservo.cameras.models import CentralModel, Pinhole

_NUMBERS = {"LENSMODEL_PINHOLE": 0, **{f"LENSMODEL_OPENCV{count}": count for count in (4, 5, 8, 12)}}
"""of the distortion"""


def recognises(fields: Any) -> bool:
    """Say whether the fields are those of a camera model of mrcal, with any lens."""
    return MRCAL in fields


def names(file: CalibrationFile) -> list[str]:
    """Return one empty name: a file has one camera."""
    return [""]


def read(file: CalibrationFile, name: str) -> CentralModel:
    """Return the camera.

    Raises:
        InputError: another lens model, or a field is missing or not legal.
    """
    count = _NUMBERS[file.word(_NUMBERS, MRCAL, "lensmodel")]
    fx, fy, cx, cy, *distortion = file.numbers(4 + count, MRCAL, "intrinsics", nonzero=(0, 1))
    size = file.image_size(file.numbers(2, MRCAL, "imagersize"), MRCAL, "imagersize")
    return file.build(Pinhole, fx=fx, fy=fy, cx=cx, cy=cy, **size, distortion=tuple(distortion))
