"""Kalibr's camera chain: cam0, cam1, … of model ``omni`` with distortion ``radtan`` or ``none``.

intrinsics = [ξ, fx, fy, cx, cy], distortion_coeffs = [k1, k2, p1, p2]; source: Kalibr's page on YAML formats.
"""

from __future__ import annotations

import re
from typing import Any

from omniservo.calibration.calibration_file import CalibrationFile, foreign_fields
from omniservo.cameras import UnifiedCamera


def recognises(fields: Any) -> bool:
    """Say whether the fields are a Kalibr camera chain of any model."""
    return any(re.fullmatch(r"cam\d+", str(key)) for key in fields)


def names(file: CalibrationFile) -> list[str]:
    """Return the names of the file's cameras, in the file's order."""
    return [key for key in file.fields if re.fullmatch(r"cam\d+", str(key))]


def read(file: CalibrationFile, name: str) -> UnifiedCamera:
    """Return the camera of this name.

    Raises:
        InputError: another camera or distortion model, or a field is missing or not legal.
    """
    model = file.value(name, "camera_model")
    if model != "omni":
        raise file.error(f"{model!r} given; legal: 'omni'", name, "camera_model")
    kind = file.value(name, "distortion_model")
    if kind not in ("radtan", "none"):
        raise file.error(f"{kind!r} given; legal: 'radtan', 'none'", name, "distortion_model")
    xi, fx, fy, cx, cy = file.numbers(5, name, "intrinsics", nonzero=(1, 2))
    width, height = file.numbers(2, name, "resolution", nonzero=(0, 1))
    distortion = file.numbers(4, name, "distortion_coeffs") if kind == "radtan" else (0.0,) * 4
    if xi < 0.0:
        raise file.error(f"xi = {xi:g} given; legal: >= 0", name, "intrinsics")
    return file.camera(
        name, fx=fx, fy=fy, cx=cx, cy=cy, xi=xi, width=width, height=height, distortion=distortion
    )


def fields_of(camera: UnifiedCamera) -> dict[str, Any]:
    """Return the file's fields: a chain of one camera.

    Raises:
        InputError: the format cannot hold the camera.
    """
    fields = {
        "camera_model": "omni",
        "distortion_coeffs": list(camera.distortion),
        "distortion_model": "radtan",
        "intrinsics": [camera.xi, camera.fx, camera.fy, camera.cx, camera.cy],
        "resolution": [camera.width, camera.height],
        **foreign_fields(camera, "kalibr"),
    }
    return {"cam0": fields}
