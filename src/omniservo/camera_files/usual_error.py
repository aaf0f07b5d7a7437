"""The model error of a camera that was read from a file: as the file or the caller says, or the usual one.

Calibrations leave an error that is alike over regions of the image. What `omniservo camera calibrate` finds
of it on boards seen by six lenses (`python -m benchmarks.real_coverage`, docs/uncertainty.md) is, over the
image's longer side, 1.5 to 3.8 · 10⁻⁴ where the model has coefficients of distortion (four lenses), 2.9 and
4.5 · 10⁻⁴ where it has none (two); 0.5 to 1.8 times the rms distance of corners that calibration left. For
files without coefficients a third more than the larger is taken: whether their lens needs some is not known.
"""

from __future__ import annotations

from collections.abc import Mapping
from contextlib import suppress
from typing import Any

from omniservo.camera_files.calibration_file import CalibrationFile
from omniservo.camera_files.formats.opencv import STORAGE
from omniservo.cameras.model_error import ModelError, usual_model_error
from omniservo.cameras.models import CentralModel, camera_from_dict
from omniservo.errors import InputError
from omniservo.geometry.arrays import finite_number

BENT_PART = 3e-4
PLAIN_PART = 6e-4
"""σ over the image's longer side: of models with and without coefficients"""

OF_RMS = 1.3
"""σ over the rms distance of corners, where the file says that"""

LEAST_PART = 1e-4
"""of the longer side: no less is accepted of a small rms"""

_PLAIN = ("unified", "pinhole")
_RMS = (
    "avg_reprojection_error",
    "mean_reprojection_error",
    "reprojection_error",
    "rms_reprojection_error",
    "rms",
    "rms_overall",
    "rms_px",
    "rmse",
)
"""what calibration programs call it, in capitals or not; OpenCV's XML has it inside its root"""

ErrorLike = float | ModelError | None
"""σ of a model error [px], the error itself, or None: as the file says, else the usual one"""


def with_error(camera: CentralModel, error: ErrorLike, file: CalibrationFile | None) -> CentralModel:
    """Return the camera with its model error; that of a preset (``file`` None) is none where not given.

    Raises:
        InputError: an error that is not legal.
    """
    if error is None:
        if file is None or camera.model_error is not None:
            return camera
        error = usual_error(camera, file.fields)
    elif not isinstance(error, ModelError):
        sigma = finite_number("camera_error", error, minimum=0.0)
        error = usual_model_error(sigma, camera.width, camera.height)
    return camera_from_dict({**camera.to_dict(), "model_error": error.to_dict()})


def usual_error(camera: CentralModel, fields: Mapping[str, Any]) -> ModelError:
    """Return what is usually left of a camera whose file says nothing of it."""
    described, side = camera.to_dict(), max(camera.width, camera.height)
    plain = described["model"] in _PLAIN and not any(described.get("distortion", ()))
    sigma = (PLAIN_PART if plain else BENT_PART) * side
    held = fields.get(STORAGE, fields)
    stated = []
    for name in held if isinstance(held, Mapping) else ():
        if str(name).lower() in _RMS:
            with suppress(InputError):
                stated.append(finite_number(name, held[name], above=0.0))
    if stated:
        sigma = max(OF_RMS * max(stated), LEAST_PART * side)
    return usual_model_error(sigma, camera.width, camera.height)
