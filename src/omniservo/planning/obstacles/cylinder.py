"""A cylindrical obstacle: a rod with flat ends, a pipe, a table's leg."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import ClassVar, Self

import numpy as np

from omniservo.errors import InputError
from omniservo.field_docs import with_field_docs
from omniservo.geometry.arrays import FloatArray, finite_number, frozen_again
from omniservo.planning.checks import LARGEST, SMALLEST, bounded_array, own_clearance, own_motion
from omniservo.planning.constraints.body_gap import CYLINDER
from omniservo.planning.constraints.round_gap import cylinder_distance
from omniservo.planning.obstacles.core import Core, along_segment
from omniservo.short_repr import short_repr


@with_field_docs
@dataclass(frozen=True, eq=False)
class Cylinder:
    """The points between two parallel discs of a radius, about ``start`` and ``end``, in the initial frame.

    Raises:
        InputError: not finite, a radius or a length below 1e-9 m, a negative clearance, or a number beyond
            1e6 m.
    """

    start: FloatArray
    """(3,) centre of one end [m], read-only; "from" in a file"""
    end: FloatArray
    """(3,) of the other [m], read-only; "to" in a file"""
    radius: float
    """[m], ≥ 1e-9"""
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
        length = float(np.linalg.norm(self.end - self.start))
        if not length >= SMALLEST:
            raise InputError(f"to: {length:g} m from the other end given; legal: at least {SMALLEST:g} m")
        radius = finite_number("radius", self.radius, minimum=SMALLEST, maximum=LARGEST)
        object.__setattr__(self, "radius", radius)
        object.__setattr__(self, "clearance", own_clearance(self.clearance))
        object.__setattr__(self, "motion", own_motion(self.motion))

    @property
    def core(self) -> Core:
        """What the proof separates from the path."""
        center, axes, half = along_segment(self.start, self.end)
        return Core(center, axes, np.array([half, self.radius, self.radius]), shape=CYLINDER)

    def distance(self, points: FloatArray) -> FloatArray:
        """Return the distance of points (k, 3) to the surface [m] (k,), negative inside.

        Where it stands without its motion.
        """
        core = self.core
        half = float(core.half_extents[0]), self.radius, self.radius
        own = (points - core.center) @ core.axes.T
        return np.array([cylinder_distance(half, *place)[3] for place in own.tolist()])

    def grown(self, metres: float) -> Self:
        """Return one that holds all within so many metres of it."""
        more = metres * self.core.axes[0]
        return replace(self, start=self.start - more, end=self.end + more, radius=self.radius + metres)
