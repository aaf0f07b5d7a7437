"""ViSP's camera XML (``vpXmlParserCamera``): cameras with a name and one or more projection models.

- perspectiveProjWithoutDistortion: (fx, fy, cx, cy) = (px, py, u0, v0);
- perspectiveProjWithDistortion: u = u0 + px x (1 + kud r²), r² = x² + y², which is OpenCV's k1 = kud alone.
  kdu is ViSP's approximate inverse, x = (u − u0)/px (1 + kdu r_d²); it is not read, since the exact one is
  used, and written as −kud;
- ProjWithKannalaBrandtDistortion: r = θ + k1 θ³ + k2 θ⁵ + k3 θ⁷ + k4 θ⁹; ViSP stores a k5 that it does not
  use.

(0, 0) is a pixel's centre. A file may hold one camera under several models and image sizes: each is listed as
"name model widthxheight". Source: ViSP's vpMeterPixelConversion and vpXmlParserCamera.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from omniservo.camera_files.calibration_file import CalibrationFile, lens_fields, refuse_skew
from omniservo.camera_files.document import FieldPath
from omniservo.camera_files.xml_document import xml_text
from omniservo.cameras.models import CentralModel, KannalaBrandt, Pinhole
from omniservo.errors import InputError, spelled

KINDS: tuple[type, ...] = (KannalaBrandt, Pinhole)

_PLAIN, _RADIAL = "perspectiveProjWithoutDistortion", "perspectiveProjWithDistortion"
_MORE = "additional_information"
_KANNALA = "ProjWithKannalaBrandtDistortion"


def recognises(fields: Any) -> bool:
    """Say whether the fields are ViSP's, with any projection model."""
    root = fields.get("root")
    return isinstance(root, Mapping) and "camera" in root


def names(file: CalibrationFile) -> list[str]:
    """Return the camera's name, or "name model widthxheight" of each where there are several."""
    entries = _entries(file)
    if len(entries) == 1:
        return [str(entries[0][2])]
    return [_full_name(file, *entry) for entry in entries]


def read(file: CalibrationFile, name: str) -> CentralModel:
    """Return the camera of this name.

    Raises:
        InputError: another projection model, or a field is missing or not legal.
    """
    camera, at, _ = _entries(file)[names(file).index(name)]
    kind = file.word((_PLAIN, _RADIAL, _KANNALA), *at, "type")
    given: dict[str, Any] = {}
    for ours, theirs in (("fx", "px"), ("fy", "py"), ("cx", "u0"), ("cy", "v0")):
        given[ours] = file.number(*at, theirs, nonzero=theirs in ("px", "py"))
    sides = ("image_width", "image_height")
    known = all(side in file.value(*camera) for side in sides)
    size = tuple(file.number(*camera, side, minimum=1.0) for side in sides) if known else None
    given |= file.image_size(size, *camera, sides[0])
    lens = (*camera, _MORE) if isinstance(file.value(*camera).get(_MORE), Mapping) else camera
    if kind == _PLAIN:
        return file.build(Pinhole, *lens, **given)
    if kind == _KANNALA:
        return file.build(
            KannalaBrandt, *lens, **given, k=tuple(file.number(*at, f"k{i}") for i in (1, 2, 3, 4))
        )
    kud = file.number(*at, "kud")
    return file.build(Pinhole, *lens, **given, distortion=(kud, 0.0, 0.0, 0.0) if kud else ())


def text_of(model: CentralModel, suffix: str) -> str:
    """Return the file's text, XML with one camera called Camera.

    Raises:
        InputError: the format cannot hold the camera.
    """
    refuse_skew(model, "visp")
    added: dict[str, float] = {}
    if isinstance(model, KannalaBrandt):
        kind = _KANNALA
        added = {f"k{i}": value for i, value in enumerate((*model.k, 0.0), start=1)}
    elif isinstance(model, Pinhole) and not any(model.distortion[1:]):
        kind = _RADIAL if any(model.distortion) else _PLAIN
        added = {"kud": model.distortion[0], "kdu": -model.distortion[0]} if kind == _RADIAL else {}
    else:
        raise InputError("format 'visp' holds a pinhole camera with k1 alone, and Kannala–Brandt")
    focal = {"px": model.fx, "py": model.fy, "u0": model.cx, "v0": model.cy}
    lens = lens_fields(model)
    fields = {
        "name": "Camera",
        "image_width": model.width,
        "image_height": model.height,
        "model": {"type": kind, **focal, **added},
        **({_MORE: lens} if lens else {}),
    }
    return xml_text({"camera": fields}, "root")


def _entries(file: CalibrationFile) -> list[tuple[FieldPath, FieldPath, Any]]:
    """Return the paths of a camera and of one of its models, and the camera's name, for each model."""
    found: list[tuple[FieldPath, FieldPath, Any]] = []
    for camera in _paths(file, "root", "camera"):
        name = file.value(*camera).get("name", "")
        found += [(camera, model, name) for model in _paths(file, *camera, "model")]
    return found


def _paths(file: CalibrationFile, *path: str | int) -> list[FieldPath]:
    """Return the path of a mapping, or of each of a list of them."""
    value = file.value(*path)
    paths = [(*path, i) for i in range(len(value))] if isinstance(value, list) else [path]
    for one in paths:
        if not isinstance(file.value(*one), Mapping):
            raise file.error(f"{spelled(file.value(*one))} given; elements are needed", *one)
    return paths


def _full_name(file: CalibrationFile, camera: FieldPath, model: FieldPath, name: Any) -> str:
    held = file.value(*camera)
    size = f" {held['image_width']}x{held['image_height']}" if "image_width" in held else ""
    return f"{name} {file.value(*model, 'type')}{size}"
