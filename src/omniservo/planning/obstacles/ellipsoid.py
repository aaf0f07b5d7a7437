"""An ellipsoidal obstacle: what fits closely round a hand, a head, a tool."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from typing import ClassVar, Self

import numpy as np

from omniservo.errors import InputError
from omniservo.field_docs import with_field_docs
from omniservo.geometry.arrays import FloatArray, frozen_again
from omniservo.planning.checks import SMALLEST, bounded_array, own_clearance, own_motion, unit_vector
from omniservo.planning.constraints.body_gap import ELLIPSOID
from omniservo.planning.constraints.round_gap import ellipsoid_distance
from omniservo.planning.obstacles.core import Core, axes_of
from omniservo.short_repr import short_repr


@with_field_docs
@dataclass(frozen=True, eq=False)
class Ellipsoid:
    """The points center + R(quaternion) y with Σ (y_k/radii_k)² ≤ 1, in the initial camera frame.

    Raises:
        InputError: not finite, a radius below 1e-9 m, a quaternion that is not unit within 1e-6, a negative
            clearance, or a number beyond 1e6 m.
    """

    center: FloatArray
    """(3,) [m], read-only"""
    radii: FloatArray
    """(3,) [m], ≥ 1e-9, along its own axes, read-only"""
    quaternion: FloatArray = field(default_factory=lambda: np.array([0.0, 0.0, 0.0, 1.0]))
    """its axes in the initial camera frame (4,), (x, y, z, w), unit, read-only; default: the same"""
    clearance: float | None = None
    """what the camera centre keeps from its surface [m]; None: the problem's clearance"""
    motion: FloatArray | None = None
    """displacement at w (3, k+1), highest power first [m], k ≤ 16, read-only; None: it stands still"""

    FIELDS: ClassVar = {"center": "center", "quaternion": "quaternion", "radii": "radii"}

    __repr__ = short_repr
    __setstate__ = frozen_again

    def __post_init__(self) -> None:
        object.__setattr__(self, "center", bounded_array("center", self.center, (3,)))
        radii = bounded_array("radii", self.radii, (3,))
        if not np.all(radii >= SMALLEST):
            raise InputError(f"radii: {radii.tolist()} given; legal: at least {SMALLEST:g} m each")
        object.__setattr__(self, "radii", radii)
        object.__setattr__(self, "quaternion", unit_vector("quaternion", self.quaternion, 4))
        object.__setattr__(self, "clearance", own_clearance(self.clearance))
        object.__setattr__(self, "motion", own_motion(self.motion))

    @property
    def core(self) -> Core:
        """What the proof separates from the path."""
        return Core(self.center, axes_of(self.quaternion), self.radii, shape=ELLIPSOID)

    def distance(self, points: FloatArray) -> FloatArray:
        """Return the distance of points (k, 3) to the surface [m] (k,).

        Negative inside: a depth that the point has at least. Where it stands without its motion.
        """
        radii = float(self.radii[0]), float(self.radii[1]), float(self.radii[2])
        own = (points - self.center) @ axes_of(self.quaternion).T
        return np.array([ellipsoid_distance(radii, *place)[3] for place in own.tolist()])

    def grown(self, metres: float) -> Self:
        """Return one that holds all within so many metres of it.

        λ times the ellipsoid reaches λ s(n) along n, where it itself reaches s(n) ≥ min radii.
        """
        return replace(self, radii=self.radii * (1.0 + metres / self.radii.min()))
