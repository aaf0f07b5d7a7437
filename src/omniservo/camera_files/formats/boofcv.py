"""BoofCV's YAML: ``model`` with ``pinhole`` and what the model adds; a stereo file has left and right.

| model | beside pinhole (fx, fy, skew, cx, cy, width, height) |
|---|---|
| pinhole | – |
| pinhole_radial_tangential | radial_tangential: radial k1, k2, k3, and t1, t2 (OpenCV's p1, p2) |
| omnidirectional_universal | the same with k1, k2, and mirror_offset, our ξ |
| kannala_brandt | symmetric s1…s5: r = s1 θ + s2 θ³ + …, so that our fx is fx s1 and our k1 is s2/s1 |

(0, 0) is the **corner** of the first pixel, so ½ is subtracted from the principal point. Source: BoofCV's
page "Coordinate Systems" and its classes CalibrationIO, CameraUniversalOmni, CameraKannalaBrandt.
Kannala–Brandt's asymmetric terms (radial, tangent and their _trig) are no model of ours.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from omniservo.camera_files.calibration_file import CalibrationFile, lens_fields
from omniservo.camera_files.document import FieldPath
from omniservo.camera_files.formats.spelling import as_yaml
from omniservo.cameras import UnifiedCamera
from omniservo.cameras.models import CentralModel, KannalaBrandt, Pinhole
from omniservo.errors import InputError

KINDS: tuple[type, ...] = (UnifiedCamera, KannalaBrandt, Pinhole)

_PINHOLE, _RADIAL = "pinhole", "pinhole_radial_tangential"
_OMNI, _KANNALA, _STEREO = "omnidirectional_universal", "kannala_brandt", "stereo_camera"
_ASYMMETRIC = ("radial", "radial_trig", "tangent", "tangent_trig")


def recognises(fields: Any) -> bool:
    """Say whether the fields are a BoofCV camera or pair of cameras."""
    return "model" in fields and ("pinhole" in fields or fields["model"] == _STEREO)


def names(file: CalibrationFile) -> list[str]:
    """Return left and right for a pair; a single camera has no name."""
    return ["left", "right"] if file.value("model") == _STEREO else [""]


def read(file: CalibrationFile, name: str) -> CentralModel:
    """Return the camera of this name.

    Raises:
        InputError: another model, or a field is missing or not legal.
    """
    at: FieldPath = (name,) if name else ()
    model = file.word((_PINHOLE, _RADIAL, _OMNI, _KANNALA), *at, "model")
    given: dict[str, Any] = {}
    for field in ("fx", "fy", "cx", "cy", "skew"):
        given[field] = file.number(*at, "pinhole", field, nonzero=field in ("fx", "fy"))
    given["cx"] -= 0.5
    given["cy"] -= 0.5
    sides = tuple(file.number(*at, "pinhole", side, minimum=1.0) for side in ("width", "height"))
    given |= file.image_size(sides, *at, "pinhole", "width")
    if model == _PINHOLE:
        return file.build(Pinhole, *at, **given)
    if model == _KANNALA:
        return _kannala_brandt(file, at, given)
    place = (*at, "radial_tangential")
    held = file.value(*place).get("radial") if isinstance(file.value(*place), Mapping) else None
    most = 2 if model == _OMNI else 3
    radial = file.coefficients(*place, "radial", legal=tuple(range(most + 1))) if held is not None else ()
    radial = (*radial, 0.0, 0.0, 0.0)[:3]
    t1, t2 = (file.number(*place, t) if file.has(*place, t) else 0.0 for t in ("t1", "t2"))
    distortion = (radial[0], radial[1], t1, t2)
    if model == _RADIAL:
        return file.build(Pinhole, *at, **given, distortion=(*distortion, radial[2]))
    xi = file.number(*at, "mirror_offset", minimum=0.0)
    return file.build(UnifiedCamera, *at, **given, xi=xi, distortion=distortion)


def _kannala_brandt(file: CalibrationFile, at: FieldPath, given: dict[str, Any]) -> KannalaBrandt:
    for field in _ASYMMETRIC:
        if file.has(*at, field) and any(file.matrix(*at, field)):
            raise file.error("asymmetric distortion; legal: none, or zeros", *at, field)
    symmetric = file.coefficients(*at, "symmetric", legal=(1, 2, 3, 4, 5))
    first, *rest = symmetric
    if first == 0.0:
        raise file.error("[0]0 given; legal: any number but 0", *at, "symmetric")
    given |= {side: given[side] * first for side in ("fx", "fy", "skew")}
    k = tuple(value / first for value in (*rest, 0.0, 0.0, 0.0, 0.0)[:4])
    return file.build(KannalaBrandt, *at, **given, k=k)


def text_of(model: CentralModel, suffix: str) -> str:
    """Return the file's text, YAML.

    Raises:
        InputError: the format cannot hold the camera.
    """
    if not isinstance(model, UnifiedCamera | KannalaBrandt | Pinhole):
        raise InputError(f"format 'boofcv' cannot hold a {type(model).__name__}")
    kind, added = _spelled(model)
    pinhole = {
        "fx": model.fx,
        "fy": model.fy,
        "cx": model.cx + 0.5,
        "cy": model.cy + 0.5,
        "width": model.width,
        "height": model.height,
        "skew": model.skew,
    }
    return as_yaml({"model": kind, "version": 0, "pinhole": pinhole, **added, **lens_fields(model)})


def _spelled(model: UnifiedCamera | KannalaBrandt | Pinhole) -> tuple[str, dict[str, Any]]:
    """Return model and the groups beside pinhole."""
    if isinstance(model, KannalaBrandt):
        return _KANNALA, {"symmetric": [1.0, *model.k], **{field: [] for field in _ASYMMETRIC}}
    if not any(model.distortion) and isinstance(model, Pinhole):
        return _PINHOLE, {}
    if any(model.distortion[5:]):
        raise InputError(
            "format 'boofcv' holds k1, k2, p1, p2, k3 of a pinhole camera, and this one has more"
        )
    k1, k2, t1, t2, *k3 = model.distortion
    radial = {"radial_tangential": {"radial": [k1, k2, *k3], "t1": t1, "t2": t2}}
    if isinstance(model, UnifiedCamera):
        return _OMNI, {**radial, "mirror_offset": model.xi}
    return _RADIAL, radial
