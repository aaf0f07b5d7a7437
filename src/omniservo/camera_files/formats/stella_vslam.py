"""The configuration of stella_vslam and OpenVSLAM: one camera, ``Camera``.

| model | numbers |
|---|---|
| perspective | fx, fy, cx, cy; k1, k2, p1, p2, k3: radial-tangential |
| fisheye | fx, fy, cx, cy; k1 … k4 of Kannala and Brandt |

The size is ``cols`` and ``rows``; (0, 0) is a pixel's centre. Of a stereo pair it is the camera of the
rectified images. equirectangular and radial_division are refused. OpenVSLAM wrote ``Camera.model`` in place
of a section. Source: stella_vslam, ``example`` and ``src/stella_vslam/camera``. Read only.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from omniservo.camera_files.calibration_file import CalibrationFile
from omniservo.cameras.models import CentralModel, KannalaBrandt, Pinhole

_SERIES = {"perspective": ("k1", "k2", "p1", "p2", "k3"), "fisheye": ("k1", "k2", "k3", "k4")}


def recognises(fields: Any) -> bool:
    """Say whether the fields are a configuration with a camera of any model."""
    camera = fields.get("Camera")
    return "Camera.model" in fields or (isinstance(camera, Mapping) and "model" in camera)


def names(file: CalibrationFile) -> list[str]:
    """Return the names of the file's cameras: one, which needs none."""
    return [""]


def read(file: CalibrationFile, name: str) -> CentralModel:
    """Return the camera.

    Raises:
        InputError: another model, or a field is missing or not legal.
    """

    def at(field: str) -> tuple[str, ...]:
        return ("Camera", field) if file.has("Camera") else (f"Camera.{field}",)

    kind = file.word(_SERIES, *at("model"))
    given: dict[str, Any] = {x: file.number(*at(x), nonzero=x[0] == "f") for x in ("fx", "fy", "cx", "cy")}
    size = tuple(file.number(*at(side), minimum=1.0) for side in ("cols", "rows"))
    given |= file.image_size(size, *at("cols"))
    series = tuple(file.number(*at(k)) for k in _SERIES[kind])
    if kind == "fisheye":
        return file.build(KannalaBrandt, **given, k=series)
    return file.build(Pinhole, **given, distortion=series)
