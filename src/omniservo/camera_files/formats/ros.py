"""ROS ``sensor_msgs/CameraInfo``: a file of camera_calibration, or the message as YAML.

| | file | message (ROS 1, ROS 2) |
|---|---|---|
| K | camera_matrix {rows, cols, data} | K, k |
| distortion | distortion_coefficients {rows, cols, data} | D, d |
| size | image_width, image_height | width, height |

``distortion_model``: plumb_bob (k1, k2, p1, p2, k3) and rational_polynomial (8, 12 or 14 numbers), both taken
as OpenCV's, in any number of them, as ROS's image_geometry does; equidistant, which some call fisheye
(Kannala–Brandt, k1…k4, then zeros if any); none or no numbers: no distortion. (0, 0) is a pixel's centre. K
and D describe the image as the camera gives it, and that is what is read; R and P describe the rectified one
and are left alone.
Source: the comments of sensor_msgs/CameraInfo. An image that is binned or a part of the sensor is refused:
K is the whole sensor's then, and drivers differ on where a binned pixel's centre is.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from omniservo.camera_files.calibration_file import CalibrationFile, lens_fields, refuse_skew
from omniservo.camera_files.formats.spelling import as_json, as_yaml
from omniservo.cameras.models import CentralModel, KannalaBrandt, Pinhole
from omniservo.errors import InputError

KINDS: tuple[type, ...] = (KannalaBrandt, Pinhole)

_OPENCV = (0, 4, 5, 8, 12, 14)
_COUNTS = {
    "plumb_bob": _OPENCV,
    "rational_polynomial": _OPENCV,
    "equidistant": (4, 5, 8),  # drivers fill up with zeros
    "fisheye": (4, 5, 8),
    "none": (0,),
    "": (0,),
}
_FISHEYE = ("equidistant", "fisheye")
_K, _D = ("camera_matrix", "K", "k"), ("distortion_coefficients", "D", "d")
_WIDTH, _HEIGHT = ("image_width", "width"), ("image_height", "height")


def recognises(fields: Any) -> bool:
    """Say whether the fields are a CameraInfo with any distortion model."""
    return "distortion_model" in fields and any(name in fields for name in _K)


def names(file: CalibrationFile) -> list[str]:
    """Return the name of the file's one camera."""
    return [str(file.fields.get("camera_name", ""))]


def read(file: CalibrationFile, name: str) -> CentralModel:
    """Return the camera.

    Raises:
        InputError: another distortion model, a part of the sensor, or a field is missing or not legal.
    """
    kind = file.word(_COUNTS, "distortion_model")
    _refuse_part_of_sensor(file)
    place = _first(file, _K)
    if not any(file.matrix(place)):
        raise file.error("all are 0, with which ROS says that the camera is not calibrated", place)
    given: dict[str, Any] = file.intrinsics(place)
    sides = [_first(file, _WIDTH), _first(file, _HEIGHT)]
    given |= file.image_size(tuple(file.number(side, minimum=1.0) for side in sides), sides[0])
    held = any(name in file.fields for name in _D)
    place = _first(file, _D) if held or kind in _FISHEYE else ""
    coefficients = file.coefficients(place, legal=_COUNTS[kind]) if place else ()
    if kind in _FISHEYE:
        if any(coefficients[4:]):
            raise file.error(f"{len(coefficients)} numbers given; legal: k1 to k4, then zeros", place)
        return file.build(KannalaBrandt, **given, k=coefficients[:4])
    return file.build(Pinhole, **given, distortion=coefficients)


def lens_of(model: CentralModel) -> tuple[KannalaBrandt | Pinhole, str, tuple[float, ...]]:
    """Return the camera, its distortion model and coefficients.

    Raises:
        InputError: ROS has no name for it, or the image is skewed.
    """
    refuse_skew(model, "ros")
    if isinstance(model, KannalaBrandt):
        return model, "equidistant", tuple(model.k)
    if not isinstance(model, Pinhole):
        raise InputError(f"format 'ros' cannot hold a {type(model).__name__}")
    given = tuple(model.distortion)
    kind = "plumb_bob" if len(given) <= 5 else "rational_polynomial"
    return model, kind, given if len(given) not in (0, 4) else (*given, *(0.0,) * 5)[:5]


def text_of(model: CentralModel, suffix: str) -> str:
    """Return the text of a camera_calibration file, YAML, or JSON for .json; P is K, and R is 1.

    Raises:
        InputError: the format cannot hold the camera.
    """
    lens, kind, coefficients = lens_of(model)
    k = [lens.fx, 0.0, lens.cx, 0.0, lens.fy, lens.cy, 0.0, 0.0, 1.0]
    p = [lens.fx, 0.0, lens.cx, 0.0, 0.0, lens.fy, lens.cy, 0.0, 0.0, 0.0, 1.0, 0.0]
    fields = {
        "image_width": model.width,
        "image_height": model.height,
        "camera_name": "camera",
        "camera_matrix": _matrix(3, 3, k),
        "distortion_model": kind,
        "distortion_coefficients": _matrix(1, len(coefficients), list(coefficients)),
        "rectification_matrix": _matrix(3, 3, [1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0]),
        "projection_matrix": _matrix(3, 4, p),
        **lens_fields(model),
    }
    return as_json(fields) if suffix == ".json" else as_yaml(fields)


def _matrix(rows: int, cols: int, data: list[float]) -> dict[str, Any]:
    return {"rows": rows, "cols": cols, "data": data}


def _first(file: CalibrationFile, names: tuple[str, ...]) -> str:
    """Return the first of the names that is in the file; the first of all where none is."""
    return next((name for name in names if name in file.fields), names[0])


def _refuse_part_of_sensor(file: CalibrationFile) -> None:
    for name in ("binning_x", "binning_y"):
        if file.has(name) and file.number(name) > 1.0:
            raise file.error("a binned image; legal: 0 or 1", name)
    roi = file.fields.get("roi")
    if isinstance(roi, Mapping):
        for name in ("x_offset", "y_offset"):
            if file.has("roi", name) and file.number("roi", name) != 0.0:
                raise file.error("a part of the sensor; legal: 0", "roi", name)
        for name, whole in (("width", _WIDTH), ("height", _HEIGHT)):
            if file.has("roi", name):
                side = file.number("roi", name)
                if side not in (0.0, file.number(_first(file, whole))):
                    raise file.error("a part of the sensor; legal: 0 or the whole", "roi", name)
