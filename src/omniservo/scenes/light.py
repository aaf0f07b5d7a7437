"""How a scene is lit."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from omniservo.errors import InputError
from omniservo.geometry.arrays import FloatArray, finite_array, finite_number


@dataclass(frozen=True, order=True)
class Light:
    """Light from all sides and from a far lamp, without shadows.

    A matt surface with normal n shows the share b (a + (1 − a) max(0, n·l)) of its own grey, with brightness
    b, ambient share a and the unit vector l towards the lamp.
    """

    since: float = 0.0
    """from when it shines so [s]"""
    brightness: float = 1.0
    """b; what is brighter than 1 is clipped to white"""
    ambient: float = 0.68
    """a, in [0, 1]"""
    direction: tuple[float, float, float] = (-0.55, 0.25, 0.80)
    """towards the lamp, in the world, of any length but 0; from above and behind the arm, so that boards
    facing it are bright"""

    def __post_init__(self) -> None:
        finite_number("light: since", self.since, minimum=0.0)
        finite_number("light: brightness", self.brightness, minimum=0.0)
        finite_number("light: ambient", self.ambient, minimum=0.0, maximum=1.0)
        if not finite_array("light: direction", self.direction, (3,)).any():
            raise InputError(f"light: direction: {self.direction} given; its length must not be 0")

    def share(self, normals: FloatArray) -> FloatArray:
        """Return the share (n,) of its own grey that a surface with these unit normals (n, 3) shows."""
        towards = np.asarray(self.direction) / np.abs(self.direction).max()  # squares may overflow
        towards /= np.linalg.norm(towards)
        lit = np.maximum(np.einsum("ij,j->i", normals, towards), 0.0)  # BLAS would start threads here
        shares: FloatArray = self.brightness * (self.ambient + (1.0 - self.ambient) * lit)
        return shares
