"""CamOdoCal's MEI format, also inside a VINS configuration: OpenCV's YAML 1.0 with ``model_type: MEI``.

ξ = mirror_parameters.xi, (k1, k2, p1, p2) = distortion_parameters, (fx, fy, cx, cy) =
(gamma1, gamma2, u0, v0) of projection_parameters; source: CamOdoCal's ``CataCamera``.
"""

from __future__ import annotations

from typing import Any

from omniservo.calibration.calibration_file import CalibrationFile, foreign_fields
from omniservo.cameras import UnifiedCamera

HEADER = "%YAML:1.0\n---\n"


def recognises(fields: Any) -> bool:
    """Say whether the fields are a CamOdoCal camera of any model."""
    return "model_type" in fields


def names(file: CalibrationFile) -> list[str]:
    """Return the name of the file's one camera."""
    return [str(file.fields.get("camera_name", ""))]


def read(file: CalibrationFile, name: str) -> UnifiedCamera:
    """Return the camera.

    Raises:
        InputError: another camera model, or a field is missing or not legal.
    """
    model = file.value("model_type")
    if model != "MEI":
        raise file.error(f"{model!r} given; legal: 'MEI'", "model_type")
    distortion = [file.number("distortion_parameters", k) for k in ("k1", "k2", "p1", "p2")]
    return file.camera(
        fx=file.number("projection_parameters", "gamma1", nonzero=True),
        fy=file.number("projection_parameters", "gamma2", nonzero=True),
        cx=file.number("projection_parameters", "u0"),
        cy=file.number("projection_parameters", "v0"),
        xi=file.number("mirror_parameters", "xi", minimum=0.0),
        width=file.number("image_width", minimum=1.0),
        height=file.number("image_height", minimum=1.0),
        distortion=distortion,
    )


def fields_of(camera: UnifiedCamera) -> dict[str, Any]:
    """Return the file's fields.

    Raises:
        InputError: the format cannot hold the camera.
    """
    k1, k2, p1, p2 = camera.distortion
    return {
        "model_type": "MEI",
        "camera_name": "camera",
        "image_width": camera.width,
        "image_height": camera.height,
        "mirror_parameters": {"xi": camera.xi},
        "distortion_parameters": {"k1": k1, "k2": k2, "p1": p1, "p2": p2},
        "projection_parameters": {"gamma1": camera.fx, "gamma2": camera.fy, "u0": camera.cx, "v0": camera.cy},
        **foreign_fields(camera, "mei"),
    }
