"""Random draws that stay the same: PCG64 and its uniform numbers alone, one named seed a problem."""

from __future__ import annotations

import math

import numpy as np
from scipy.spatial.transform import Rotation

from omniservo.geometry.arrays import FloatArray

YEAR = 20120601
"""The first word of every seed."""


class Draws:
    """The stream of problem ``index`` of the set named ``name``."""

    def __init__(self, name: str, index: int) -> None:
        words = [YEAR, *name.encode(), index]
        self._random = np.random.Generator(np.random.PCG64(words)).random

    def number(self, least: float, most: float) -> float:
        """Return a number, uniform in [least, most)."""
        return float(least + (most - least) * self._random())

    def whole(self, least: int, most: int) -> int:
        """Return a whole number, uniform in least … most."""
        return least + int(self._random() * (most + 1 - least))

    def numbers(self, least: float, most: float, *shape: int) -> FloatArray:
        """Return an array of such numbers."""
        return np.asarray(least + (most - least) * self._random(shape))

    def direction(self) -> FloatArray:
        """Return a unit vector (3,), uniform on the sphere."""
        height, around = self.number(-1.0, 1.0), self.number(0.0, 2.0 * math.pi)
        ring = math.sqrt(1.0 - height * height)
        return np.array([ring * math.cos(around), ring * math.sin(around), height])

    def across(self, axis: FloatArray) -> FloatArray:
        """Return a unit vector (3,) at right angles to ``axis``."""
        side = np.cross(axis, self.direction())
        return np.asarray(side / np.linalg.norm(side))

    def turn(self, degrees: float) -> Rotation:
        """Return a rotation about any axis by at most so many degrees."""
        return Rotation.from_rotvec(self.direction() * math.radians(self.number(0.0, degrees)))
