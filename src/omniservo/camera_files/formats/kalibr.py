"""Kalibr's camera chain: cam0, cam1, …, each a projection with a distortion.

| camera_model | intrinsics | distortion_model (distortion_coeffs) |
|---|---|---|
| omni | ξ, fx, fy, cx, cy | radtan (k1, k2, p1, p2), none |
| eucm | α, β, fx, fy, cx, cy | none |
| ds | ξ, α, fx, fy, cx, cy | none |
| pinhole | fx, fy, cx, cy | radtan, none; equidistant (k1…k4: Kannala–Brandt) |

resolution = [width, height]; (0, 0) is a pixel's centre. Source: Kalibr's pages on YAML formats and on
supported models. ``fov`` is no model of ours.
"""

from __future__ import annotations

import re
from typing import Any

from omniservo.camera_files.calibration_file import CalibrationFile, lens_fields, refuse_skew
from omniservo.camera_files.formats.spelling import as_json, as_yaml
from omniservo.cameras import UnifiedCamera
from omniservo.cameras.models import CentralModel, DoubleSphere, ExtendedUnified, KannalaBrandt, Pinhole
from omniservo.errors import InputError

KINDS: tuple[type, ...] = (UnifiedCamera, ExtendedUnified, DoubleSphere, KannalaBrandt, Pinhole)

_FOCAL = ("fx", "fy", "cx", "cy")
_INTRINSICS = {
    "omni": ("xi", *_FOCAL),
    "eucm": ("alpha", "beta", *_FOCAL),
    "ds": ("xi", "alpha", *_FOCAL),
    "pinhole": _FOCAL,
}
_DISTORTIONS = {
    "omni": ("radtan", "none"),
    "eucm": ("none",),
    "ds": ("none",),
    "pinhole": ("radtan", "equidistant", "none"),
}


def recognises(fields: Any) -> bool:
    """Say whether the fields are a Kalibr camera chain of any model."""
    return any(re.fullmatch(r"cam\d+", str(key)) for key in fields)


def names(file: CalibrationFile) -> list[str]:
    """Return the names of the file's cameras, in the file's order."""
    return [key for key in file.fields if re.fullmatch(r"cam\d+", str(key))]


def read(file: CalibrationFile, name: str) -> CentralModel:
    """Return the camera of this name.

    Raises:
        InputError: another camera or distortion model, or a field is missing or not legal.
    """
    model = file.word(_INTRINSICS, name, "camera_model")
    kind = file.word(_DISTORTIONS[model], name, "distortion_model")
    order = _INTRINSICS[model]
    nonzero = (order.index("fx"), order.index("fy"))
    numbers = file.numbers(len(order), name, "intrinsics", nonzero=nonzero)
    given: dict[str, Any] = dict(zip(order, numbers, strict=True))
    given |= file.image_size(file.numbers(2, name, "resolution"), name, "resolution")
    coefficients = () if kind == "none" else file.numbers(4, name, "distortion_coeffs")
    if model == "omni":
        if given["xi"] < 0.0:
            raise file.error(f"xi = {given['xi']:g} given; legal: >= 0", name, "intrinsics")
        return file.build(UnifiedCamera, name, **given, distortion=coefficients or (0.0,) * 4)
    if model == "eucm":
        return file.build(ExtendedUnified, name, **given)
    if model == "ds":
        return file.build(DoubleSphere, name, **given)
    if kind == "equidistant":
        return file.build(KannalaBrandt, name, **given, k=coefficients)
    return file.build(Pinhole, name, **given, distortion=coefficients)


def text_of(model: CentralModel, suffix: str) -> str:
    """Return the file's text: a chain of one camera, YAML, or JSON for .json.

    Raises:
        InputError: the format cannot hold the camera.
    """
    refuse_skew(model, "kalibr")
    kind, distortion, coefficients = _spelled(model)
    fields = {
        "camera_model": kind,
        "distortion_coeffs": list(coefficients),
        "distortion_model": distortion,
        "intrinsics": [getattr(model, name) for name in _INTRINSICS[kind]],
        "resolution": [model.width, model.height],
        **lens_fields(model),
    }
    return as_json({"cam0": fields}) if suffix == ".json" else as_yaml({"cam0": fields})


def _spelled(model: CentralModel) -> tuple[str, str, tuple[float, ...]]:
    """Return camera_model, distortion_model and distortion_coeffs."""
    if isinstance(model, UnifiedCamera):
        return "omni", "radtan", model.distortion
    if isinstance(model, ExtendedUnified):
        return "eucm", "none", ()
    if isinstance(model, DoubleSphere):
        return "ds", "none", ()
    if isinstance(model, KannalaBrandt):
        return "pinhole", "equidistant", model.k
    if isinstance(model, Pinhole) and not any(model.distortion[4:]):
        distortion = model.distortion[:4]
        return ("pinhole", "radtan", distortion) if any(distortion) else ("pinhole", "none", ())
    raise InputError("format 'kalibr' holds k1, k2, p1, p2 of a pinhole camera, and this one has more")
