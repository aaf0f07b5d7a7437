"""Our own format: the camera of a problem file with ``"format": "omniservo.camera/1"``, JSON or YAML."""

from __future__ import annotations

from typing import Any

from omniservo.calibration.calibration_file import CalibrationFile
from omniservo.cameras import UnifiedCamera

_FORMAT = "omniservo.camera/1"


def recognises(fields: Any) -> bool:
    """Say whether the fields are of this format, in any version."""
    return str(fields.get("format", "")).startswith("omniservo.camera/")


def names(file: CalibrationFile) -> list[str]:
    """Return the names of the file's cameras: one, which has none."""
    return [""]


def read(file: CalibrationFile, name: str) -> UnifiedCamera:
    """Return the camera.

    Raises:
        InputError: another version, or a field is missing, unknown or not legal.
    """
    if file.fields["format"] != _FORMAT:
        raise file.error(f"{file.fields['format']!r} given; legal: {_FORMAT!r}", "format")
    fields = {key: value for key, value in file.fields.items() if key != "format"}
    return UnifiedCamera.from_dict(fields, source=file.source)


def fields_of(camera: UnifiedCamera) -> dict[str, Any]:
    """Return the file's fields."""
    return {"format": _FORMAT, **camera.to_dict()}
