"""CamOdoCal's format, also inside a VINS configuration: OpenCV's YAML 1.0 with ``model_type``.

- MEI: ξ = mirror_parameters.xi, (k1, k2, p1, p2) = distortion_parameters, (fx, fy, cx, cy) =
  (gamma1, gamma2, u0, v0) of projection_parameters (``CataCamera``);
- KANNALA_BRANDT: r = θ + k2 θ³ + k3 θ⁵ + k4 θ⁷ + k5 θ⁹ and (fx, fy, cx, cy) = (mu, mv, u0, v0), all of
  projection_parameters (``EquidistantCamera``): its k2…k5 are our k1…k4;
- PINHOLE: (k1, k2, p1, p2) = distortion_parameters, (fx, fy, cx, cy) = projection_parameters.

(0, 0) is a pixel's centre. Source: the named classes of CamOdoCal's camera models.
"""

from __future__ import annotations

from typing import Any

from omniservo.camera_files.calibration_file import CalibrationFile, lens_fields, refuse_skew
from omniservo.camera_files.formats.spelling import as_yaml
from omniservo.cameras import UnifiedCamera
from omniservo.cameras.models import CentralModel, KannalaBrandt, Pinhole
from omniservo.errors import InputError

KINDS: tuple[type, ...] = (UnifiedCamera, KannalaBrandt, Pinhole)

_HEADER = "%YAML:1.0\n---\n"
_RADTAN = ("k1", "k2", "p1", "p2")
_SERIES = ("k2", "k3", "k4", "k5")
_PROJECTION = {
    "MEI": ("gamma1", "gamma2", "u0", "v0"),
    "KANNALA_BRANDT": ("mu", "mv", "u0", "v0"),
    "PINHOLE": ("fx", "fy", "cx", "cy"),
}


def recognises(fields: Any) -> bool:
    """Say whether the fields are a CamOdoCal camera of any model."""
    return "model_type" in fields


def names(file: CalibrationFile) -> list[str]:
    """Return the name of the file's one camera."""
    return [str(file.fields.get("camera_name", ""))]


def read(file: CalibrationFile, name: str) -> CentralModel:
    """Return the camera.

    Raises:
        InputError: another camera model, or a field is missing or not legal.
    """
    model = file.word(_PROJECTION, "model_type")
    given: dict[str, Any] = {}
    for ours, theirs in zip(("fx", "fy", "cx", "cy"), _PROJECTION[model], strict=True):
        given[ours] = file.number("projection_parameters", theirs, nonzero=ours in ("fx", "fy"))
    size = [file.number(side, minimum=1.0) for side in ("image_width", "image_height")]
    given |= file.image_size(tuple(size), "image_width")
    if model == "KANNALA_BRANDT":
        k = tuple(file.number("projection_parameters", name) for name in _SERIES)
        return file.build(KannalaBrandt, **given, k=k)
    distortion = tuple(file.number("distortion_parameters", name) for name in _RADTAN)
    if model == "PINHOLE":
        return file.build(Pinhole, **given, distortion=distortion)
    xi = file.number("mirror_parameters", "xi", minimum=0.0)
    return file.build(UnifiedCamera, **given, xi=xi, distortion=distortion)


def text_of(model: CentralModel, suffix: str) -> str:
    """Return the file's text, YAML 1.0.

    Raises:
        InputError: the format cannot hold the camera.
    """
    refuse_skew(model, "camodocal")
    kind, before, after = _spelled(model)
    focal = zip(_PROJECTION[kind], (model.fx, model.fy, model.cx, model.cy), strict=True)  # type: ignore[attr-defined]  # all three kinds have them
    fields: dict[str, Any] = {
        "model_type": kind,
        "camera_name": "camera",
        "image_width": model.width,
        "image_height": model.height,
        **before,
        "projection_parameters": {**after, **dict(focal)},
        **lens_fields(model),
    }
    return as_yaml(fields, _HEADER)


def _spelled(model: CentralModel) -> tuple[str, dict[str, Any], dict[str, float]]:
    """Return model_type, the groups before projection_parameters and what that begins with."""
    if isinstance(model, UnifiedCamera):
        distortion = dict(zip(_RADTAN, model.distortion, strict=True))
        mei = {"mirror_parameters": {"xi": model.xi}, "distortion_parameters": distortion}
        return "MEI", mei, {}
    if isinstance(model, KannalaBrandt):
        return "KANNALA_BRANDT", {}, dict(zip(_SERIES, model.k, strict=True))
    if isinstance(model, Pinhole) and not any(model.distortion[4:]):
        distortion = dict(zip(_RADTAN, (*model.distortion, 0.0, 0.0, 0.0, 0.0)[:4], strict=True))
        return "PINHOLE", {"distortion_parameters": distortion}, {}
    raise InputError("format 'camodocal' holds k1, k2, p1, p2 of a pinhole camera, and this one has more")
