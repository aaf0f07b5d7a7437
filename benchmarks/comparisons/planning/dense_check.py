"""A path looked at 20 000 times: what sampling can say of it, and all that is said of a polyline."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from benchmarks.comparisons.planning.attempt import Polyline
from benchmarks.comparisons.planning.neutral import Neutral
from benchmarks.comparisons.planning.pose_check import FAMILIES, least_values
from scipy.spatial.transform import Rotation, Slerp

from omniservo.geometry.arrays import FloatArray
from omniservo.planning import CameraPath

LOOKS = 20_000
"""Samples of w, evenly on [0, 1]."""

MEETS = 1e-9
"""Ends are met within this, in m and in the unit quaternion."""


class Seen(NamedTuple):
    """What the samples show."""

    least: float
    """the smallest g (`samples`) of all families"""
    family: str
    """whose it is"""
    w: float
    """where"""
    ends_meet: bool
    length: float
    """of the way of the camera centre [m]"""


def look(neutral: Neutral, path: CameraPath | Polyline) -> Seen:
    """Look at a path at `LOOKS` places."""
    w = np.linspace(0.0, 1.0, LOOKS)
    turns, centres = _polynomial(path, w) if isinstance(path, CameraPath) else _polyline(path, w)
    least, index = least_values(neutral, turns, centres)
    length = float(np.linalg.norm(np.diff(centres, axis=0), axis=1).sum())
    meets = _meets(turns[0], np.array([0.0, 0.0, 0.0, 1.0])) and _meets(turns[-1], neutral.quaternion)
    meets = meets and bool(np.abs(centres[0]).max() < MEETS)
    meets = meets and bool(np.abs(centres[-1] - neutral.translation).max() < MEETS)
    return Seen(float(least.min()), FAMILIES[int(np.argmin(least))], float(w[index]), meets, length)


def _polynomial(path: CameraPath, w: FloatArray) -> tuple[FloatArray, FloatArray]:
    turns = np.stack([np.polyval(row, w) for row in path.rotation], axis=1)
    return turns, np.stack([np.polyval(row, w) for row in path.translation], axis=1)


def _polyline(path: Polyline, w: FloatArray) -> tuple[FloatArray, FloatArray]:
    at = np.linspace(0.0, 1.0, len(path.positions))
    centres = np.stack([np.interp(w, at, column) for column in path.positions.T], axis=1)
    return Slerp(at, Rotation.from_quat(path.quaternions))(w).as_quat(), centres


def _meets(given: FloatArray, wanted: FloatArray) -> bool:
    unit = given / max(float(np.linalg.norm(given)), 1e-12)
    return bool(min(np.abs(unit - wanted).max(), np.abs(unit + wanted).max()) < MEETS)
