"""Basalt's calibration.json: ``value0`` with ``intrinsics`` and ``resolution``, cameras cam0, cam1, ….

| camera_type | intrinsics |
|---|---|
| pinhole | fx, fy, cx, cy |
| pinhole-radtan8 | the same and k1, k2, p1, p2, k3 … k6 (OpenCV's rational model), rpmax |
| kb4 | fx, fy, cx, cy, k1 … k4 (Kannala–Brandt) |
| ucm | fx, fy, cx, cy, α: the unified model with ξ = α/(1−α) and focal lengths fx(1+ξ), fy(1+ξ) |
| eucm | fx, fy, cx, cy, α, β |
| ds | fx, fy, cx, cy, ξ, α |

rpmax, the largest radius on the plane Z = 1 where above 0, becomes max_angle. (0, 0) is a pixel's centre.
Source: the camera headers of basalt-headers and V. Usenko, N. Demmel, D. Cremers, "The Double Sphere Camera
Model", 3DV 2018. What we write has the camera alone: a Basalt file also holds T_imu_cam and IMU numbers,
which are no part of a camera.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

from omniservo.camera_files.calibration_file import CalibrationFile, lens_fields, refuse_skew
from omniservo.camera_files.formats.spelling import as_json
from omniservo.cameras import UnifiedCamera
from omniservo.cameras.models import CentralModel, DoubleSphere, ExtendedUnified, KannalaBrandt, Pinhole
from omniservo.errors import InputError, spelled

KINDS: tuple[type, ...] = (DoubleSphere, ExtendedUnified, KannalaBrandt, UnifiedCamera, Pinhole)

_FOCAL = ("fx", "fy", "cx", "cy")
_SERIES = ("k1", "k2", "k3", "k4")
_RATIONAL = ("k1", "k2", "p1", "p2", "k3", "k4", "k5", "k6")
_PARAMETERS: dict[str, tuple[str, ...]] = {
    "pinhole": (),
    "pinhole-radtan8": _RATIONAL,
    "kb4": _SERIES,
    "ucm": ("alpha",),
    "eucm": ("alpha", "beta"),
    "ds": ("xi", "alpha"),
}


def recognises(fields: Any) -> bool:
    """Say whether the fields are a Basalt calibration with any camera."""
    return isinstance(fields.get("value0"), Mapping) and "intrinsics" in fields["value0"]


def names(file: CalibrationFile) -> list[str]:
    """Return cam0, cam1, …, one for each entry of intrinsics."""
    cameras = file.value("value0", "intrinsics")
    if not isinstance(cameras, list) or not cameras:
        raise file.error(f"{spelled(cameras)} given; a list of cameras is needed", "value0", "intrinsics")
    return [f"cam{i}" for i in range(len(cameras))]


def read(file: CalibrationFile, name: str) -> CentralModel:
    """Return the camera of this name.

    Raises:
        InputError: another camera type, or a field is missing or not legal.
    """
    index = int(name.removeprefix("cam"))
    at = ("value0", "intrinsics", index)
    kind = file.word(_PARAMETERS, *at, "camera_type")
    inside = (*at, "intrinsics")
    focal = {n: file.number(*inside, n, nonzero=n in ("fx", "fy")) for n in _FOCAL}
    rest = {n: file.number(*inside, n) for n in _PARAMETERS[kind]}
    resolution = ("value0", "resolution", index)
    given: dict[str, Any] = {**focal, **file.image_size(file.numbers(2, *resolution), *resolution)}
    if kind == "ucm":
        return _unified(file, given, rest["alpha"], at)
    if kind == "eucm":
        return file.build(ExtendedUnified, *at, **given, **rest)
    if kind == "ds":
        return file.build(DoubleSphere, *at, **given, **rest)
    if kind == "kb4":
        return file.build(KannalaBrandt, *at, **given, k=tuple(rest.values()))
    rpmax = file.number(*inside, "rpmax", minimum=0.0) if file.value(*inside).get("rpmax") else 0.0
    if rpmax > 0.0:
        given["max_angle"] = math.atan(rpmax)
    return file.build(Pinhole, *at, **given, distortion=tuple(rest.values()))


def _unified(
    file: CalibrationFile, given: dict[str, Any], alpha: float, at: tuple[str | int, ...]
) -> UnifiedCamera:
    if not 0.0 <= alpha < 1.0:
        raise file.error(f"{alpha:g} given; legal: >= 0 and < 1", *at, "intrinsics", "alpha")
    scale = 1.0 / (1.0 - alpha)
    given |= {"fx": given["fx"] * scale, "fy": given["fy"] * scale, "xi": alpha * scale}
    return file.build(UnifiedCamera, *at, **given)


def text_of(model: CentralModel, suffix: str) -> str:
    """Return the file's text, JSON with one camera.

    Raises:
        InputError: the format cannot hold the camera.
    """
    refuse_skew(model, "basalt")
    kind, parameters = _spelled(model)
    camera = {"camera_type": kind, "intrinsics": parameters, **lens_fields(model)}
    return as_json({"value0": {"intrinsics": [camera], "resolution": [[model.width, model.height]]}})


def _spelled(model: CentralModel) -> tuple[str, dict[str, float]]:
    """Return camera_type and intrinsics."""
    if isinstance(model, UnifiedCamera):
        if model.is_distorted:
            raise InputError("format 'basalt' holds the unified model without distortion only")
        scale = 1.0 + model.xi
        focal = {"fx": model.fx / scale, "fy": model.fy / scale, "cx": model.cx, "cy": model.cy}
        return "ucm", {**focal, "alpha": model.xi / scale}
    if isinstance(model, DoubleSphere | ExtendedUnified):
        kind = "ds" if isinstance(model, DoubleSphere) else "eucm"
        return kind, {n: getattr(model, n) for n in (*_FOCAL, *_PARAMETERS[kind])}
    if isinstance(model, KannalaBrandt):
        return "kb4", {n: getattr(model, n) for n in _FOCAL} | dict(zip(_SERIES, model.k, strict=True))
    if isinstance(model, Pinhole) and not any(model.distortion[8:]):
        focal = {n: getattr(model, n) for n in _FOCAL}
        if not any(model.distortion):
            return "pinhole", focal
        padded = (*model.distortion, *(0.0,) * 8)[:8]
        return "pinhole-radtan8", focal | dict(zip(_RATIONAL, padded, strict=True)) | {"rpmax": 0.0}
    raise InputError("format 'basalt' holds at most the 8 numbers of the rational model")
