"""Our own format: the camera of a problem file with ``"format": "omniservo.camera/1"``, JSON or YAML.

Any model; ``model`` names it. It keeps everything that a camera says.
"""

from __future__ import annotations

from typing import Any

from omniservo.calibration.calibration_file import CalibrationFile
from omniservo.calibration.formats.spelling import as_json, as_yaml
from omniservo.cameras.models import CentralModel, camera_from_dict

KINDS: tuple[type, ...] = ()
"""every model"""

_FORMAT = "omniservo.camera/1"


def recognises(fields: Any) -> bool:
    """Say whether the fields are of this format, in any version."""
    return str(fields.get("format", "")).startswith("omniservo.camera/")


def names(file: CalibrationFile) -> list[str]:
    """Return the names of the file's cameras: one, which has none."""
    return [""]


def read(file: CalibrationFile, name: str) -> CentralModel:
    """Return the camera.

    Raises:
        InputError: another version, or a field is missing, unknown or not legal.
    """
    if file.fields["format"] != _FORMAT:
        raise file.error(f"{file.fields['format']!r} given; legal: {_FORMAT!r}", "format")
    fields = {key: value for key, value in file.fields.items() if key != "format"}
    model = camera_from_dict(fields, source=file.source)
    file.image_size((model.width, model.height), "width")
    return model


def text_of(model: CentralModel, suffix: str) -> str:
    """Return the file's text: JSON for .json, else YAML."""
    fields = {"format": _FORMAT, **model.to_dict()}
    return as_json(fields) if suffix == ".json" else as_yaml(fields)
