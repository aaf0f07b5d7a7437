"""``transforms.json`` of nerfstudio and instant-ngp: one camera for all frames, with COLMAP's numbers.

camera_model OPENCV, PINHOLE, SIMPLE_PINHOLE or none: pinhole with k1, k2, p1, p2, where they stand;
OPENCV_FISHEYE, or is_fisheye: Kannala–Brandt, k1…k4. Focal lengths are fl_x and fl_y, or follow from
camera_angle_x and camera_angle_y [rad], the whole angles of the image; the second is the first where it is
missing. Their cx, cy are COLMAP's, where (0.5, 0.5) is the first pixel's centre: ½ is subtracted; where they
are missing the centre is the image's. instant-ngp's other lenses (ftheta_p0 …, latlong) are refused.
Source: nerfstudio's page on data conventions, its ``colmap_utils``, and instant-ngp's ``colmap2nerf.py``. A
camera of each frame's own is refused. Read only.
"""

from __future__ import annotations

import math
from typing import Any

from omniservo.camera_files.calibration_file import CalibrationFile
from omniservo.cameras.models import CentralModel, KannalaBrandt, Pinhole

_PINHOLES = ("OPENCV", "PINHOLE", "SIMPLE_PINHOLE", "PERSPECTIVE")
_FISHEYE = "OPENCV_FISHEYE"
_OTHER_LENSES = ("ftheta_p0", "latlong")
_COEFFICIENTS = ("k1", "k2", "k3", "k4", "p1", "p2")


def recognises(fields: Any) -> bool:
    """Say whether the fields are a transforms.json, of any camera."""
    return "frames" in fields or "fl_x" in fields or "camera_angle_x" in fields


def names(file: CalibrationFile) -> list[str]:
    """Return the names of the file's cameras: one, which has none."""
    return [""]


def read(file: CalibrationFile, name: str) -> CentralModel:
    """Return the camera.

    Raises:
        InputError: another camera model, a camera for each frame, or a field is missing or not legal.
    """
    for field in _OTHER_LENSES:
        if file.has(field):
            raise file.error("a lens that no model of ours has; legal: OpenCV's", field)
    kind = "OPENCV"
    if file.has("camera_model"):
        kind = file.word((*_PINHOLES, _FISHEYE), "camera_model")
    elif file.fields.get("is_fisheye"):
        kind = _FISHEYE
    sides = tuple(file.number(side, minimum=1.0) for side in ("w", "h")) if file.has("w") else None
    size = file.image_size(sides, "w")
    given: dict[str, Any] = {**_focal_lengths(file, size), **size}
    for centre, side in (("cx", "width"), ("cy", "height")):
        given[centre] = (file.number(centre) if file.has(centre) else 0.5 * size[side]) - 0.5
    numbers = {field: file.number(field) if file.has(field) else 0.0 for field in _COEFFICIENTS}
    if kind == _FISHEYE:
        return file.build(KannalaBrandt, **given, k=tuple(numbers[f"k{i}"] for i in (1, 2, 3, 4)))
    if numbers["k4"] != 0.0:
        raise file.error(f"{numbers['k4']:g} given; legal with this camera_model: 0", "k4")
    radtan = tuple(numbers[field] for field in ("k1", "k2", "p1", "p2", "k3"))
    return file.build(Pinhole, **given, distortion=radtan if any(radtan) else ())


def _focal_lengths(file: CalibrationFile, size: dict[str, int]) -> dict[str, float]:
    """Return fx and fy [px].

    Raises:
        InputError: there are none, or each frame has its own.
    """
    fx = _focal_length(file, "x", size["width"])
    if fx is None:
        raise file.error("missing; a camera for all frames is read, not one of each frame's own", "fl_x")
    fy = _focal_length(file, "y", size["height"])
    return {"fx": fx, "fy": fx if fy is None else fy}


def _focal_length(file: CalibrationFile, axis: str, side: int) -> float | None:
    """Return the focal length along an axis that the image has ``side`` pixels of; None: it is missing."""
    if file.has(f"fl_{axis}"):
        return file.number(f"fl_{axis}", nonzero=True)
    field = f"camera_angle_{axis}"
    if not file.has(field):
        return None
    angle = file.number(field)
    if not 0.0 < angle < math.pi:
        raise file.error(f"{angle:g} given; legal: more than 0 and less than pi [rad]", field)
    return 0.5 * side / math.tan(0.5 * angle)
