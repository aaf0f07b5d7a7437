"""What the comparisons with other libraries share: the libraries, their camera, and the clock."""

from __future__ import annotations

import importlib
import math
from collections.abc import Callable
from time import perf_counter
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


def shortest(call: Callable[[], object], rounds: int = 3) -> float:
    """Return the shortest of a few calls [µs]: a shared machine only adds."""
    best = math.inf
    for _ in range(rounds):
        before = perf_counter()
        call()
        best = min(best, perf_counter() - before)
    return 1e6 * best
