"""A camera as OpenCV's own FileStorage writes it."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import cv2
import numpy as np

from omniservo.camera_files.calibration_file import lens_fields, refuse_skew
from omniservo.cameras import UnifiedCamera
from omniservo.cameras.models import CentralModel, KannalaBrandt, Pinhole
from omniservo.errors import InputError

_SUFFIXES = {".xml": ".xml", ".json": ".json"}


def storage_text(model: CentralModel, suffix: str) -> str:
    """Return the text of a storage with image_width, image_height, camera_matrix, distortion_coefficients.

    A unified camera has xi too, and all others fisheye_model, 1 or 0, as in OpenCV's camera_calibration
    sample.

    Raises:
        InputError: OpenCV has no such model, or leaves skew out of it: of K it takes that for omnidir only.
    """
    if not isinstance(model, UnifiedCamera | KannalaBrandt | Pinhole):
        raise InputError(f"format 'opencv' cannot hold a {type(model).__name__}")
    if not isinstance(model, UnifiedCamera):
        refuse_skew(model, "opencv")
    flags = cv2.FILE_STORAGE_WRITE | cv2.FILE_STORAGE_MEMORY
    storage = cv2.FileStorage(_SUFFIXES.get(suffix, ".yaml"), flags)
    storage.write("image_width", model.width)
    storage.write("image_height", model.height)
    matrix = [[model.fx, model.skew, model.cx], [0.0, model.fy, model.cy], [0.0, 0.0, 1.0]]
    storage.write("camera_matrix", np.array(matrix))
    if isinstance(model, UnifiedCamera):
        storage.write("distortion_coefficients", np.array([model.distortion]))
        storage.write("xi", float(model.xi))
    else:
        fisheye = isinstance(model, KannalaBrandt)
        storage.write("fisheye_model", int(fisheye))
        numbers = model.k if isinstance(model, KannalaBrandt) else model.distortion or (0.0,) * 5
        storage.write("distortion_coefficients", np.array([numbers]).T if fisheye else np.array([numbers]))
    for name, value in lens_fields(model).items():
        _write(storage, name, value)
    return str(storage.releaseAndGetString())


def _write(storage: Any, name: str, value: Any) -> None:
    """Write numbers, lists and mappings, nested as they are."""
    if isinstance(value, Mapping):
        storage.startWriteStruct(name, cv2.FileNode_MAP)
        for key, inner in value.items():
            _write(storage, key, inner)
        storage.endWriteStruct()
    elif isinstance(value, list | tuple):
        storage.startWriteStruct(name, cv2.FileNode_SEQ | cv2.FileNode_FLOW)
        for inner in value:
            _write(storage, "", inner)
        storage.endWriteStruct()
    else:
        storage.write(name, float(value))
