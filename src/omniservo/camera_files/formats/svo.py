"""SVO's and maplab's camera YAML: entries with ``type``, ``intrinsics.data`` and ``distortion``.

They stand in a list ``cameras``; in maplab's also in that of a sensor of a list ``sensors``, or one alone.

- omni: polynomial a0…a4, centre x and y, affine c, d, e, 12 numbers of the inverse polynomial and 2 of a
  mask, which are not read; (u, v) = [[1, e], [d, c]] (x, y) + centre, as in `ocamcalib` after its change of
  axes;
- pinhole: fx, fy, cx, cy, with distortion none, radial-tangential (k1, k2, p1, p2) or equidistant (k1…k4).

(0, 0) is a pixel's centre. Source: rpg_svo_pro_open, ``vikit/cameras`` (omni_projection, yaml). Read only.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from omniservo.camera_files.calibration_file import CalibrationFile
from omniservo.camera_files.document import FieldPath
from omniservo.cameras.models import CentralModel, KannalaBrandt, OcamPolynomial, Pinhole

_DISTORTIONS = ("none", "radial-tangential", "equidistant")


def recognises(fields: Any) -> bool:
    """Say whether the fields are SVO's or maplab's cameras of any type."""
    return bool(_places(fields))


def names(file: CalibrationFile) -> list[str]:
    """Return the cameras' labels, or cam0, cam1, … where there are none."""
    found: list[str] = []
    for place in _places(file.fields):
        described = file.value(*place)
        label = described.get("label", described.get("topic")) if isinstance(described, Mapping) else None
        found.append(str(label or f"cam{len(found)}"))
    return found


def read(file: CalibrationFile, name: str) -> CentralModel:
    """Return the camera of this name.

    Raises:
        InputError: another type of camera or distortion, or a field is missing or not legal.
    """
    at = _places(file.fields)[names(file).index(name)]
    sides = tuple(file.number(*at, side, minimum=1.0) for side in ("image_width", "image_height"))
    size = file.image_size(sides, *at, "image_width")
    kind = file.word(("omni", "pinhole"), *at, "type")
    if kind == "omni":
        numbers = file.coefficients(*at, "intrinsics", legal=(24,))
        return file.build(
            OcamPolynomial,
            *at,
            coefficients=numbers[:5],
            cx=numbers[5],
            cy=numbers[6],
            **size,
            stretch=numbers[7:10],
        )
    fx, fy, cx, cy = file.coefficients(*at, "intrinsics", legal=(4,))
    given: dict[str, Any] = {"fx": fx, "fy": fy, "cx": cx, "cy": cy, **size}
    distorted = file.value(*at).get("distortion") is not None
    distortion = file.word(_DISTORTIONS, *at, "distortion", "type") if distorted else "none"
    if distortion == "none":
        return file.build(Pinhole, *at, **given)
    four = file.coefficients(*at, "distortion", "parameters", legal=(4,))
    if distortion == "equidistant":
        return file.build(KannalaBrandt, *at, **given, k=four)
    return file.build(Pinhole, *at, **given, distortion=four)


def _places(fields: Any) -> list[FieldPath]:
    """Return where the cameras stand."""
    if isinstance(fields, Mapping) and {"type", "intrinsics", "image_width"} <= set(fields):
        return [()]
    holders: list[tuple[FieldPath, Any]] = [((), fields)]
    sensors = fields.get("sensors")
    holders += [(("sensors", i), held) for i, held in enumerate(sensors if isinstance(sensors, list) else ())]
    found: list[FieldPath] = []
    for path, held in holders:
        cameras = held.get("cameras") if isinstance(held, Mapping) else None
        if isinstance(cameras, list) and all(isinstance(c, Mapping) and "camera" in c for c in cameras):
            found += [(*path, "cameras", index, "camera") for index in range(len(cameras))]
    return found
