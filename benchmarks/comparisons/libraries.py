"""What the comparisons with other libraries share: the libraries and their camera."""

from __future__ import annotations

import importlib
from typing import Any

import numpy as np

from omniservo import UnifiedCamera
from omniservo.geometry.arrays import FloatArray


def peer(name: str) -> Any:
    """Return the library; None where it is not installed (requirements-bench.lock has it)."""
    try:
        return importlib.import_module(name)
    except ImportError:
        return None


def plane_focal(camera: UnifiedCamera) -> float:
    """Return the focal length of the perspective camera with as many px for an angle on the axis [px]."""
    return camera.fx / (1.0 + camera.xi)


def on_plane(camera: UnifiedCamera, bearings: FloatArray) -> FloatArray:
    """Return the pixels (n, 2) of bearings (n, 3) in that perspective camera, its centre at (0, 0)."""
    return np.ascontiguousarray(plane_focal(camera) * bearings[:, :2] / bearings[:, 2:])
