"""JSON schema of a camera, from the models' own fields."""

from __future__ import annotations

import math
from dataclasses import MISSING, fields
from inspect import signature

from omniservo.camera_files.formats.own import FORMAT
from omniservo.cameras.models import MODEL_CLASSES
from omniservo.cameras.models.lens_model import LensModel
from omniservo.cameras.unified_camera import UnifiedCamera
from omniservo.schemas.shapes import (
    NOT_NEGATIVE,
    NUMBER,
    POSITIVE,
    Schema,
    either,
    mapping,
    nullable,
    said,
    several,
    vector,
)

_SIZE: Schema = {"type": "integer", "minimum": 1, "maximum": 100_000}
_DISC = either(
    mapping({"center": said(vector(2), "[px]"), "radius": said(POSITIVE, "[px]")}),
    said(
        {"type": "array", "prefixItems": [vector(2), NUMBER], "minItems": 2, "maxItems": 2}, "center, radius"
    ),
)
_ANGLE = {"type": "number", "exclusiveMinimum": 0, "maximum": math.pi}

_FIELDS: dict[str, Schema] = {
    "fx": said(NUMBER, "focal length [px], not 0"),
    "fy": said(NUMBER, "focal length [px], not 0"),
    "cx": said(NUMBER, "principal point [px]; (0, 0) is the centre of the top-left pixel"),
    "cy": said(NUMBER, "principal point [px]"),
    "skew": said(NUMBER, "[px]"),
    "xi": said(NUMBER, "ξ of the model; a perspective camera has 0"),
    "alpha": {"type": "number", "minimum": 0, "maximum": 1},
    "beta": POSITIVE,
    "width": said(_SIZE, "[px]"),
    "height": said(_SIZE, "[px]"),
    "k": said(vector(4), "k1, k2, k3, k4"),
    "coefficients": said(several(NUMBER, 1, 20), "a0, a1, a2, … with a_i in px^(1−i), a0 < 0"),
    "stretch": said(vector(3), "c, d, e"),
    "max_angle": said(_ANGLE, "largest angle from the axis that the lens sees [rad]"),
    "dead_zone": said(_DISC, "disc in which the image shows the camera itself"),
    "mask": said(
        several(several(vector(2), 3, 64), 0, 64),
        "convex polygons [px] in which the image shows the camera itself, or nothing",
    ),
    "deviation_px": said(NOT_NEGATIVE, "how far a true pixel may lie from the model's [px]"),
    "model_error": said(
        mapping({"sigma_px": NOT_NEGATIVE, "length_px": POSITIVE}),
        "what the lens model itself is off by [px], alike over length_px",
    ),
    "calibration_covariance": said(
        {"oneOf": [several(vector(size), size, size) for size in (5, 9)]},
        "how exactly fx, fy, cx, cy, xi (5) and k1, k2, p1, p2 (9) are known, as a calibration found",
    ),
}
_DISTORTION = {
    "unified": said(vector(4), "k1, k2, p1, p2"),
    "pinhole": said(several(NUMBER, 0, 14), "OpenCV's coefficients in its order: 0, 4, 5, 8, 12 or 14"),
}


def camera_schema() -> Schema:
    """Return the schema of a camera's fields, as they stand in a problem or a task."""
    unified = signature(UnifiedCamera).parameters.values()
    required = [parameter.name for parameter in unified if parameter.default is parameter.empty]
    optional = [parameter.name for parameter in unified if parameter.default is not parameter.empty]
    return {"oneOf": [_model("unified", required, optional), *map(_lens_model, MODEL_CLASSES)]}


def camera_file_schema() -> Schema:
    """Return the schema of a camera file of our own format."""
    models = camera_schema()["oneOf"]
    return {"oneOf": [{**m, "properties": {"format": {"const": FORMAT}, **m["properties"]}} for m in models]}


def _lens_model(kind: type[LensModel]) -> Schema:
    own = [field for field in fields(kind) if field.init]
    required = [field.name for field in own if field.default is MISSING]
    return _model(kind.model, required, [field.name for field in own if field.default is not MISSING])


def _model(name: str, required: list[str], optional: list[str]) -> Schema:
    known = {**_FIELDS, **({"distortion": _DISTORTION[name]} if name in _DISTORTION else {})}
    return mapping(
        {"model": {"const": name}, **{field: known[field] for field in required}},
        {field: nullable(known[field]) for field in optional},
    )
