"""The configuration of OKVIS: a list ``cameras``, each with ``focal_length`` and ``distortion_type``.

| distortion_type | distortion_coefficients |
|---|---|
| radialtangential, radialtangential8 | k1, k2, p1, p2; and k3 … k6 |
| equidistant | k1 … k4 of Kannala and Brandt |

image_dimension = [width, height]; (0, 0) is a pixel's centre. Cameras are cam0, cam1, … in the file's order.
Source: ethz-asl/okvis and okvis2, ``config`` and ``ViParametersReader.cpp``. Read only.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from omniservo.camera_files.calibration_file import CalibrationFile
from omniservo.cameras.models import CentralModel, KannalaBrandt, Pinhole

_COUNTS = {"radialtangential": 4, "radialtangential8": 8, "equidistant": 4}


def recognises(fields: Any) -> bool:
    """Say whether the fields are a configuration of OKVIS with any camera."""
    cameras = fields.get("cameras")
    return (
        isinstance(cameras, list)
        and bool(cameras)
        and all(isinstance(camera, Mapping) and "focal_length" in camera for camera in cameras)
    )


def names(file: CalibrationFile) -> list[str]:
    """Return cam0, cam1, … in the file's order."""
    return [f"cam{index}" for index in range(len(file.value("cameras")))]


def read(file: CalibrationFile, name: str) -> CentralModel:
    """Return the camera of this name.

    Raises:
        InputError: another type of distortion, or a field is missing or not legal.
    """
    at = ("cameras", names(file).index(name))
    fx, fy = file.numbers(2, *at, "focal_length", nonzero=(0, 1))
    cx, cy = file.numbers(2, *at, "principal_point")
    size = file.image_size(file.numbers(2, *at, "image_dimension"), *at, "image_dimension")
    given: dict[str, Any] = {"fx": fx, "fy": fy, "cx": cx, "cy": cy, **size}
    kind = file.word(_COUNTS, *at, "distortion_type")
    distortion = file.numbers(_COUNTS[kind], *at, "distortion_coefficients")
    if kind == "equidistant":
        return file.build(KannalaBrandt, *at, **given, k=distortion)
    return file.build(Pinhole, *at, **given, distortion=distortion)
