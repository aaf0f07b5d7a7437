"""Which way is up in the figures of space."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy.spatial.transform import RigidTransform

from omniservo.geometry.arrays import FloatArray

_NAMES = "xyz"


@dataclass(frozen=True)
class UprightAxes:
    """Which axis of the initial camera frame is drawn along which axis of the page: upright.

    The plotted coordinates are a rotation of the camera's, so nothing is mirrored.
    """

    order: tuple[int, int, int]
    """index of the camera axis drawn along the plot's x, y and z"""
    signs: tuple[int, int, int]
    """−1 where it is drawn backwards"""

    @classmethod
    def for_start(cls, world_T_initial: RigidTransform) -> UprightAxes:
        """Draw the camera axis nearest to the world's up upwards, the optical axis to the right if it can."""
        up = world_T_initial.rotation.as_matrix()[2]
        vertical = int(np.argmax(np.abs(up)))
        first = 2 if vertical != 2 else 0
        second = 3 - vertical - first
        sign_up = 1 if up[vertical] > 0 else -1
        even = (first, second, vertical) in ((0, 1, 2), (1, 2, 0), (2, 0, 1))
        sign_second = sign_up if even else -sign_up
        return cls((first, second, vertical), (1, sign_second, sign_up))

    def apply(self, points: FloatArray) -> FloatArray:
        """Return points (…, 3) [m] of the initial camera frame as plotted, (…, 3) [mm], not yet reversed."""
        return np.asarray(1000.0 * points[..., list(self.order)], dtype=np.float64)

    def name(self, axes: Any, *columns: int) -> None:
        """Name the plot's axes after the camera axes of the plotted columns; reverse the backward ones."""
        for which, column in zip("xyz", columns, strict=False):
            getattr(axes, f"set_{which}label")(f"{_NAMES[self.order[column]]} [mm]")
            if self.signs[column] < 0:
                getattr(axes, f"invert_{which}axis")()
