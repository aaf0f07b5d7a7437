"""A capsule-shaped obstacle: a rod with round ends."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import ClassVar, Self

import numpy as np

from omniservo.errors import InputError
from omniservo.field_docs import with_field_docs
from omniservo.geometry.arrays import FloatArray, finite_number, frozen_again
from omniservo.planning.checks import LARGEST, bounded_array, own_clearance, own_motion
from omniservo.planning.obstacles.core import Core, along_segment
from omniservo.short_repr import short_repr


@with_field_docs
@dataclass(frozen=True, eq=False)
class Capsule:
    """The points at most ``radius`` away from the segment from ``start`` to ``end``, in the initial frame.

    Raises:
        InputError: not finite, a radius that is not positive, a negative clearance, or a number beyond 1e6 m.
    """

    start: FloatArray
    """(3,) [m], read-only; "from" in a file"""
    end: FloatArray
    """(3,) [m], read-only; "to" in a file"""
    radius: float
    """[m], > 0"""
    clearance: float | None = None
    """what the camera centre keeps from its surface [m]; None: the problem's clearance"""
    motion: FloatArray | None = None
    """displacement at w (3, k+1), highest power first [m], k ≤ 16, read-only; None: it stands still"""

    FIELDS: ClassVar = {"from": "start", "to": "end", "radius": "radius"}

    __repr__ = short_repr
    __setstate__ = frozen_again

    def __post_init__(self) -> None:
        object.__setattr__(self, "start", bounded_array("from", self.start, (3,)))
        object.__setattr__(self, "end", bounded_array("to", self.end, (3,)))
        radius = finite_number("radius", self.radius, maximum=LARGEST)
        if not radius > 0.0:
            raise InputError(f"radius: {radius:g} given; legal: > 0")
        object.__setattr__(self, "radius", radius)
        object.__setattr__(self, "clearance", own_clearance(self.clearance))
        object.__setattr__(self, "motion", own_motion(self.motion))

    @property
    def core(self) -> Core:
        """What the proof separates from the path."""
        center, axes, half = along_segment(self.start, self.end)
        return Core(center, axes, np.array([half, 0.0, 0.0]), self.radius)

    def distance(self, points: FloatArray) -> FloatArray:
        """Return the distance of points (k, 3) to the surface [m] (k,), negative inside.

        Where it stands without its motion.
        """
        along = self.end - self.start
        square = float(along @ along)
        part = (points - self.start) @ along / square if square > 0.0 else np.zeros(len(points))
        nearest = self.start + np.clip(part, 0.0, 1.0)[:, None] * along
        return np.asarray(np.linalg.norm(points - nearest, axis=1) - self.radius)

    def grown(self, metres: float) -> Self:
        """Return one that holds all within so many metres of it."""
        return replace(self, radius=self.radius + metres)
