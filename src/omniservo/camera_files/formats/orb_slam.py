"""Settings of ORB-SLAM2 and 3, `%YAML:1.0`: ``Camera.type`` with one camera, or the two of a stereo pair.

| Camera.type | numbers |
|---|---|
| PinHole, or no type | fx, fy, cx, cy; k1, k2, p1, p2, k3 where they stand: radial-tangential |
| KannalaBrandt8 | fx, fy, cx, cy; k1 … k4 |
| Rectified | fx, fy, cx, cy of images without distortion |

They stand as ``Camera.fx``, or as ``Camera1.fx`` and ``Camera2.fx``; the old settings of a stereo fisheye
have ``Camera.fx`` and ``Camera2.fx``. The size is ``Camera.width`` and ``Camera.height``, of the images as
they come; ``newWidth`` is what ORB-SLAM makes of them. (0, 0) is a pixel's centre. Source: the calibration
tutorial of ORB-SLAM3 v1.0 and its ``Settings.cc``. Read only.
"""

from __future__ import annotations

from typing import Any

from omniservo.camera_files.calibration_file import CalibrationFile
from omniservo.cameras.models import CentralModel, KannalaBrandt, Pinhole

_FOCAL = ("fx", "fy", "cx", "cy")
_SERIES = ("k1", "k2", "k3", "k4")
_RADTAN = ("k1", "k2", "p1", "p2", "k3")
_TYPES = ("PinHole", "KannalaBrandt8", "Rectified")
_HOLDERS = ("Camera", "Camera1", "Camera2")


def recognises(fields: Any) -> bool:
    """Say whether the fields are settings of ORB-SLAM with any camera."""
    return "Camera.type" in fields or any(f"{holder}.fx" in fields for holder in _HOLDERS)


def names(file: CalibrationFile) -> list[str]:
    """Return Camera, Camera1, Camera2: those that have a focal length, or else the first."""
    return [holder for holder in _HOLDERS if file.has(f"{holder}.fx")] or ["Camera1"]


def read(file: CalibrationFile, name: str) -> CentralModel:
    """Return the camera of this name.

    Raises:
        InputError: another type of camera, or a field is missing or not legal.
    """
    kind = file.word(_TYPES, "Camera.type") if file.has("Camera.type") else "PinHole"
    given: dict[str, Any] = {x: file.number(f"{name}.{x}", nonzero=x[0] == "f") for x in _FOCAL}
    sides = [f"Camera.{side}" for side in ("width", "height")]
    stated = tuple(file.number(side, minimum=1.0) for side in sides) if file.has(sides[0]) else None
    given |= file.image_size(stated, sides[0])
    if kind == "KannalaBrandt8":
        return file.build(KannalaBrandt, **given, k=tuple(file.number(f"{name}.{k}") for k in _SERIES))
    if kind == "Rectified" or not file.has(f"{name}.k1"):
        return file.build(Pinhole, **given)
    count = len(_RADTAN) if file.has(f"{name}.k3") else len(_RADTAN) - 1
    return file.build(Pinhole, **given, distortion=tuple(file.number(f"{name}.{k}") for k in _RADTAN[:count]))
