"""A half-space as an obstacle: a wall, a floor."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from omniservo.field_docs import with_field_docs
from omniservo.geometry.arrays import FloatArray, finite_number, frozen_again
from omniservo.planning.checks import LARGEST, own_clearance, own_motion, unit_vector
from omniservo.short_repr import short_repr


@with_field_docs
@dataclass(frozen=True, eq=False)
class HalfSpace:
    """The solid normal·x < offset, in the initial camera frame: free is what the normal points to.

    It hides no target point: a point in front of it is seen from everywhere in front of it, because what is
    free is convex; a point inside it is the problem's own contradiction.

    Raises:
        InputError: not finite, a normal that is not unit within 1e-6, a negative clearance, or a number
            beyond 1e6 m.
    """

    normal: FloatArray
    """(3,), unit, read-only"""
    offset: float
    """[m]"""
    clearance: float | None = None
    """what the camera centre keeps from its surface [m]; None: the problem's clearance"""
    motion: FloatArray | None = None
    """displacement at w (3, k+1), highest power first [m], k ≤ 16, read-only; None: it stands still"""

    FIELDS: ClassVar = {"normal": "normal", "offset": "offset"}

    __repr__ = short_repr
    __setstate__ = frozen_again

    def __post_init__(self) -> None:
        object.__setattr__(self, "normal", unit_vector("normal", self.normal, 3))
        offset = finite_number("offset", self.offset, minimum=-LARGEST, maximum=LARGEST)
        object.__setattr__(self, "offset", offset)
        object.__setattr__(self, "clearance", own_clearance(self.clearance))
        object.__setattr__(self, "motion", own_motion(self.motion))

    def distance(self, points: FloatArray) -> FloatArray:
        """Return the distance of points (k, 3) to the surface [m] (k,), negative inside.

        Where it stands without its motion.
        """
        return np.asarray(points @ self.normal - self.offset)
