"""A camera as a person names it: a preset, or a calibration file."""

from __future__ import annotations

from pathlib import Path

from omniservo.camera_files.camera_files import as_unified, load_model, seen_up_to
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
) -> CentralModel:
    """Return the preset of this name, or else a calibration file's camera as `load_model` gives it.

    Raises:
        InputError: neither, or as `load_model`.
    """
    if str(camera) in PRESETS and name is None and size is None and model is None:
        return seen_up_to(PRESETS[str(camera)], max_angle)
    if not is_file(camera):
        raise InputError(
            f"camera {spelled(str(camera))}: neither a file nor a preset: {', '.join(PRESETS)}"
            f"{did_you_mean(camera, PRESETS)}"
        )
    return load_model(camera, name=name, size=size, model=model, max_angle=max_angle)


def named_camera(
    camera: str | Path,
    name: str | None = None,
    *,
    max_angle: float | None = None,
    largest_px: float = 1.0,
) -> UnifiedCamera:
    """Return `named_model` as a unified camera, at most ``largest_px`` [px] away; see `load_camera`."""
    return as_unified(named_model(camera, name=name, max_angle=max_angle), camera, largest_px)
