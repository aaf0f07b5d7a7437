"""The ``sensor.yaml`` of a camera in EuRoC's data sets and in others that are laid out like them.

camera_model pinhole: intrinsics [fu, fv, cu, cv]; distortion_model radial-tangential (k1, k2, p1, p2),
equidistant (Kannala–Brandt, k1…k4) or none; resolution = [width, height]. (0, 0) is a pixel's centre.
Source: the EuRoC MAV data set's own files, which were written with Kalibr's numbers. Read only.
"""

from __future__ import annotations

from typing import Any

from omniservo.camera_files.calibration_file import CalibrationFile
from omniservo.cameras.models import CentralModel, KannalaBrandt, Pinhole

_DISTORTIONS = ("radial-tangential", "equidistant", "none")


def recognises(fields: Any) -> bool:
    """Say whether the fields are a camera's sensor.yaml, of any model."""
    return fields.get("sensor_type") == "camera" and "intrinsics" in fields


def names(file: CalibrationFile) -> list[str]:
    """Return the names of the file's cameras: one, which has none."""
    return [""]


def read(file: CalibrationFile, name: str) -> CentralModel:
    """Return the camera.

    Raises:
        InputError: another camera or distortion model, or a field is missing or not legal.
    """
    file.word(("pinhole",), "camera_model")
    kind = file.word(_DISTORTIONS, "distortion_model")
    fx, fy, cx, cy = file.numbers(4, "intrinsics", nonzero=(0, 1))
    given: dict[str, Any] = {"fx": fx, "fy": fy, "cx": cx, "cy": cy}
    given |= file.image_size(file.numbers(2, "resolution"), "resolution")
    if kind == "none":
        return file.build(Pinhole, **given)
    four = file.numbers(4, "distortion_coefficients")
    if kind == "equidistant":
        return file.build(KannalaBrandt, **given, k=four)
    return file.build(Pinhole, **given, distortion=four)
