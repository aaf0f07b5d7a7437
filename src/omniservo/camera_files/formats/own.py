"""Our own format: the camera of a problem file with ``"format": "omniservo.camera/1"``, JSON or YAML.

Without the format, too, what ``to_dict`` gives is a camera: other formats would leave out half of it.

Any model; ``model`` names it. It keeps everything that a camera says.
"""

from __future__ import annotations

from typing import Any

from omniservo.camera_files.calibration_file import CalibrationFile
from omniservo.camera_files.formats.spelling import as_json, as_yaml
from omniservo.cameras.models import MODEL_NAMES, CentralModel, camera_from_dict

KINDS: tuple[type, ...] = ()
"""every model"""

FORMAT = "omniservo.camera/1"


def recognises(fields: Any) -> bool:
    """Say whether the fields are of this format, in any version, or one of our models and its size."""
    if "format" in fields:
        return str(fields["format"]).startswith("omniservo.camera/")
    model = fields.get("model")
    return isinstance(model, str) and model in MODEL_NAMES and "width" in fields


def names(file: CalibrationFile) -> list[str]:
    """Return the names of the file's cameras: one, which has none."""
    return [""]


def read(file: CalibrationFile, name: str) -> CentralModel:
    """Return the camera.

    Raises:
        InputError: another version, or a field is missing, unknown or not legal.
    """
    if file.fields.get("format", FORMAT) != FORMAT:
        raise file.error(f"{file.fields['format']!r} given; legal: {FORMAT!r}", "format")
    fields = {key: value for key, value in file.fields.items() if key != "format"}
    model = camera_from_dict(fields, source=file.source)
    file.image_size((model.width, model.height), "width")
    return model


def text_of(model: CentralModel, suffix: str) -> str:
    """Return the file's text: JSON for .json, else YAML."""
    fields = {"format": FORMAT, **model.to_dict()}
    return as_json(fields) if suffix == ".json" else as_yaml(fields)
