"""COLMAP's cameras.txt: a line ``id MODEL width height parameters…`` for each camera.

(0.5, 0.5) is the centre of the first pixel, so ½ is subtracted from the principal point. Source: COLMAP's
``sensor/models.h`` and its documentation of the output format. Its fisheye models are Kannala–Brandt with
none, one, two or all four of k1 … k4; the models with one focal length are our pinhole and Kannala–Brandt
with fx = fy. FOV, THIN_PRISM_FISHEYE, DIVISION and others are refused by name.
"""

from __future__ import annotations

from typing import Any

from omniservo.camera_files.calibration_file import CalibrationFile, lens_comment, refuse_skew
from omniservo.cameras.models import CentralModel, ExtendedUnified, KannalaBrandt, Pinhole
from omniservo.errors import InputError, spelled

KINDS: tuple[type, ...] = (ExtendedUnified, KannalaBrandt, Pinhole)

_PARAMETERS = {
    "SIMPLE_PINHOLE": "f cx cy",
    "PINHOLE": "fx fy cx cy",
    "SIMPLE_RADIAL": "f cx cy k1",
    "RADIAL": "f cx cy k1 k2",
    "OPENCV": "fx fy cx cy k1 k2 p1 p2",
    "FULL_OPENCV": "fx fy cx cy k1 k2 p1 p2 k3 k4 k5 k6",
    "SIMPLE_FISHEYE": "f cx cy",
    "FISHEYE": "fx fy cx cy",
    "SIMPLE_RADIAL_FISHEYE": "f cx cy k1",
    "RADIAL_FISHEYE": "f cx cy k1 k2",
    "OPENCV_FISHEYE": "fx fy cx cy k1 k2 k3 k4",
    "EUCM": "fx fy cx cy alpha beta",
}
_RATIONAL = ("k1", "k2", "p1", "p2", "k3", "k4", "k5", "k6")
_HEADER = (
    "# Camera list with one line of data per camera:\n"
    "#   CAMERA_ID, MODEL, WIDTH, HEIGHT, PARAMS[]\n# Number of cameras: 1\n"
)


def recognises(fields: Any) -> bool:
    """Say whether every row is an id and a word, of any model."""
    rows = fields.get("rows")
    return isinstance(rows, list) and all(
        isinstance(row, list) and len(row) >= 2 and isinstance(row[0], int) and isinstance(row[1], str)
        for row in rows
    )


def names(file: CalibrationFile) -> list[str]:
    """Return the cameras' ids."""
    return [str(row[0]) for row in file.fields["rows"]]


def read(file: CalibrationFile, name: str) -> CentralModel:
    """Return the camera with this id.

    Raises:
        InputError: another model, or not its numbers.
    """
    index = names(file).index(name)
    row = file.fields["rows"][index]
    model = row[1]
    if model not in _PARAMETERS:
        legal = ", ".join(_PARAMETERS)
        raise file.error(f"camera {name}: {spelled(model)} given; legal: {legal}", "rows", index)
    wanted = _PARAMETERS[model].split()
    if len(row) != 4 + len(wanted):
        needed = f"width height {_PARAMETERS[model]}"
        raise file.error(
            f"camera {name}: {len(row) - 2} numbers after {model}; needed: {needed}", "rows", index
        )
    values = [file.number("rows", index, place) for place in range(2, len(row))]
    size = file.image_size((values[0], values[1]), "rows", index)
    numbers = dict(zip(wanted, values[2:], strict=True))
    focal = {side: numbers.get(side, numbers.get("f", 0.0)) for side in ("fx", "fy")}
    if 0.0 in focal.values():
        raise file.error(f"camera {name}: a focal length of 0; legal: any number but 0", "rows", index)
    given: dict[str, Any] = {**focal, "cx": numbers["cx"] - 0.5, "cy": numbers["cy"] - 0.5, **size}
    if model == "EUCM":
        return file.build(ExtendedUnified, **given, alpha=numbers["alpha"], beta=numbers["beta"])
    if model.endswith("FISHEYE"):
        k = tuple(numbers.get(f"k{i}", 0.0) for i in (1, 2, 3, 4))
        return file.build(KannalaBrandt, **given, k=k)
    count = 8 if model == "FULL_OPENCV" else 4 if "k1" in numbers else 0
    distortion = tuple(numbers.get(field, 0.0) for field in _RATIONAL[:count])
    return file.build(Pinhole, **given, distortion=distortion)


def text_of(model: CentralModel, suffix: str) -> str:
    """Return the file's text, with one camera of id 1.

    Raises:
        InputError: the format cannot hold the camera.
    """
    refuse_skew(model, "colmap")
    if isinstance(model, KannalaBrandt):
        kind, more = "OPENCV_FISHEYE", tuple(model.k)
    elif isinstance(model, ExtendedUnified):
        kind, more = "EUCM", (model.alpha, model.beta)
    elif isinstance(model, Pinhole) and not any(model.distortion[8:]):
        padded = (*model.distortion, *(0.0,) * 8)[:8]
        kind, count = (
            ("FULL_OPENCV", 8) if any(padded[4:]) else ("OPENCV", 4) if any(padded) else ("PINHOLE", 0)
        )
        more = padded[:count]
    elif isinstance(model, Pinhole):
        raise InputError("format 'colmap' holds at most the 8 numbers of the rational model")
    else:
        raise InputError(f"format 'colmap' cannot hold a {type(model).__name__}")
    numbers = (model.fx, model.fy, model.cx + 0.5, model.cy + 0.5, *more)
    row = " ".join(map(repr, numbers))
    return f"{_HEADER}{lens_comment(model)}1 {kind} {model.width} {model.height} {row}\n"
