"""Agisoft Metashape's cameras: the XML of a calibration, or of a project's cameras with ``sensor``s.

With (x, y) = (X, Y)/Z, of a fisheye scaled to the length θ, and r = ‖(x, y)‖: x′ = x (1 + k1 r² + k2 r⁴ +
k3 r⁶ + k4 r⁸) + p1 (r² + 2x²) + 2 p2 xy, y′ alike with p2 and p1; u = width/2 + cx + x′ (f + b1) + y′ b2,
v = height/2 + cy + y′ f. Its p1 and p2 are OpenCV's p2 and p1, and (0.5, 0.5) is the first pixel's centre: ½
is subtracted. Up to version 1.5 the part of p1 and p2 was multiplied by 1 + p3 r² + p4 r⁴. Source: the
appendix on camera models of Metashape's manual. Read only.

A frame camera with k4, a fisheye with p1 or p2, and any with p3 or p4 are refused: no model of ours has them.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from omniservo.camera_files.calibration_file import CalibrationFile
from omniservo.camera_files.document import FieldPath
from omniservo.cameras.models import CentralModel, KannalaBrandt, Pinhole

_KINDS = ("frame", "fisheye", "equidistant_fisheye")
_OPTIONAL = ("cx", "cy", "b1", "b2", "k1", "k2", "k3", "k4", "p1", "p2", "p3", "p4")


def recognises(fields: Any) -> bool:
    """Say whether the fields are a calibration with a projection, or a document with sensors."""
    alone = fields.get("calibration")
    return (isinstance(alone, Mapping) and "projection" in alone) or "chunk" in _held(fields.get("document"))


def names(file: CalibrationFile) -> list[str]:
    """Return the sensors' labels, which may be alike, see `_places`; a calibration alone has no name."""
    return list(_places(file))


def read(file: CalibrationFile, name: str) -> CentralModel:
    """Return the camera of this name.

    Raises:
        InputError: another projection, numbers that no model of ours has, or a field is missing or not legal.
    """
    at = _places(file)[name]
    projection = "projection" if file.has(*at, "projection") else "@type"
    kind = file.word(_KINDS, *at, projection)
    apart = file.has(*at, "resolution")
    sides = [("resolution", f"@{side}") if apart else (side,) for side in ("width", "height")]
    width, height = (file.number(*at, *side, minimum=1.0) for side in sides)
    f = file.number(*at, "f", nonzero=True)
    number = {what: file.number(*at, what) if file.has(*at, what) else 0.0 for what in _OPTIONAL}
    given: dict[str, Any] = {
        "fx": f + number["b1"],
        "fy": f,
        "cx": 0.5 * (width - 1.0) + number["cx"],
        "cy": 0.5 * (height - 1.0) + number["cy"],
        "skew": number["b2"],
        **file.image_size((width, height), *at, *sides[0]),
    }
    for odd in ("k4", "p3", "p4") if kind == "frame" else ("p1", "p2", "p3", "p4"):
        if number[odd] != 0.0:
            raise file.error(f"{number[odd]:g} given; legal of a {kind} camera: 0", *at, odd)
    if kind != "frame":
        return file.build(KannalaBrandt, **given, k=tuple(number[f"k{i}"] for i in (1, 2, 3, 4)))
    radtan = tuple(number[what] for what in ("k1", "k2", "p2", "p1", "k3"))
    return file.build(Pinhole, **given, distortion=radtan if any(radtan) else ())


def _held(value: Any) -> Mapping[str, Any]:
    return value if isinstance(value, Mapping) else {}


def _places(file: CalibrationFile) -> dict[str, FieldPath]:
    """Return where each camera's calibration stands, by its name; of a sensor's the adjusted one.

    Sensors may have one label, as those of one kind and those of several chunks: "label (2)" is the second.

    Raises:
        InputError: no sensor has a calibration.
    """
    if "calibration" in file.fields:
        return {"": ("calibration",)}
    found: dict[str, FieldPath] = {}
    for chunk in _each(file.fields, "document", "chunk"):
        for sensor in _each(file.fields, *chunk, "sensors", "sensor"):
            label = str(file.value(*sensor, "@label")) if file.has(*sensor, "@label") else str(len(found))
            if label in found:
                label = f"{label} ({len(found) + 1})"
            for calibration in _each(file.fields, *sensor, "calibration"):
                if label not in found or file.value(*calibration).get("@class") == "adjusted":
                    found[label] = calibration
    if not found:
        raise file.error("no sensor with a calibration", "document")
    return found


def _each(fields: Any, *path: str | int) -> list[FieldPath]:
    """Return the places of an element that may stand once or several times."""
    value = fields
    for step in path:
        value = value[step] if isinstance(step, int) else _held(value).get(step)
    if isinstance(value, list):
        return [(*path, index) for index, held in enumerate(value) if isinstance(held, Mapping)]
    return [path] if isinstance(value, Mapping) else []
