"""A camera as a person names it: a preset, or a calibration file."""

from __future__ import annotations

from pathlib import Path

from omniservo.camera_files.camera_files import as_unified, read_model, seen_up_to
from omniservo.camera_files.usual_error import ErrorLike, with_error
from omniservo.cameras import PRESETS, UnifiedCamera
from omniservo.cameras.models import CentralModel
from omniservo.errors import InputError, did_you_mean, spelled
from omniservo.files import is_file


def named_model(
    camera: str | Path,
    *,
    name: str | None = None,
    size: tuple[int, int] | None = None,
    model: str | None = None,
    max_angle: float | None = None,
    camera_error: ErrorLike = None,
) -> CentralModel:
    """Return the preset of this name, or else a calibration file's camera as `load_model` gives it.

    A file's camera has a model error, as `load_camera` has it; a preset only what ``camera_error`` says.

    Raises:
        InputError: neither, or as `load_model`.
    """
    if str(camera) in PRESETS and name is None and size is None and model is None:
        return with_error(seen_up_to(PRESETS[str(camera)], max_angle), camera_error, None)
    if not is_file(camera):
        raise InputError(
            f"camera {spelled(str(camera))}: neither a file nor a preset: {', '.join(PRESETS)}"
            f"{did_you_mean(camera, PRESETS)}"
        )
    found, file = read_model(camera, name=name, size=size, model=model, max_angle=max_angle)
    return with_error(found, camera_error, file)


def named_camera(
    camera: str | Path,
    name: str | None = None,
    *,
    max_angle: float | None = None,
    largest_px: float | None = None,
    camera_error: ErrorLike = None,
) -> UnifiedCamera:
    """Return `named_model` as a unified camera, as `load_camera` does."""
    found = named_model(camera, name=name, max_angle=max_angle, camera_error=camera_error)
    return as_unified(found, camera, largest_px)
