"""A spherical obstacle."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import ClassVar, Self

import numpy as np

from omniservo.field_docs import with_field_docs
from omniservo.geometry.arrays import FloatArray, finite_number, frozen_again
from omniservo.planning.checks import LARGEST, bounded_array, own_clearance, own_motion
from omniservo.planning.obstacles.core import Core
from omniservo.short_repr import short_repr


@with_field_docs
@dataclass(frozen=True, eq=False)
class Sphere:
    """The ball ‖x − center‖ ≤ radius, in the initial camera frame.

    Raises:
        InputError: not finite, a negative radius or clearance, or a number beyond 1e6 m.
    """

    center: FloatArray
    """(3,) [m], read-only"""
    radius: float = 0.0
    """[m], ≥ 0; a sphere of radius 0 is a point and hides nothing"""
    clearance: float | None = None
    """what the camera centre keeps from its surface [m]; None: the problem's clearance"""
    motion: FloatArray | None = None
    """displacement at w (3, k+1), highest power first [m], k ≤ 16, read-only; None: it stands still"""

    FIELDS: ClassVar = {"center": "center", "radius": "radius"}

    __repr__ = short_repr
    __setstate__ = frozen_again

    def __post_init__(self) -> None:
        object.__setattr__(self, "center", bounded_array("center", self.center, (3,)))
        object.__setattr__(self, "radius", finite_number("radius", self.radius, minimum=0.0, maximum=LARGEST))
        object.__setattr__(self, "clearance", own_clearance(self.clearance))
        object.__setattr__(self, "motion", own_motion(self.motion))

    @property
    def core(self) -> Core:
        """What the proof separates from the path."""
        return Core(self.center, np.eye(3), np.zeros(3), self.radius)

    def distance(self, points: FloatArray) -> FloatArray:
        """Return the distance of points (k, 3) to the surface [m] (k,), negative inside.

        Where it stands without its motion.
        """
        return np.asarray(np.linalg.norm(points - self.center, axis=1) - self.radius)

    def grown(self, metres: float) -> Self:
        """Return one that holds all within so many metres of it."""
        return replace(self, radius=self.radius + metres)
