"""A box-shaped obstacle."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from typing import ClassVar, Self

import numpy as np
from scipy.spatial.transform import Rotation

from omniservo.errors import InputError
from omniservo.field_docs import with_field_docs
from omniservo.geometry.arrays import FloatArray, frozen_again
from omniservo.planning.checks import bounded_array, own_clearance, own_motion, unit_vector
from omniservo.planning.obstacles.core import Core, axes_of
from omniservo.short_repr import short_repr


@with_field_docs
@dataclass(frozen=True, eq=False)
class Box:
    """The points center + R(quaternion) y with |y_k| ≤ half_extents_k, in the initial camera frame.

    Raises:
        InputError: not finite, a half extent that is not positive, a quaternion that is not unit within
            1e-6, a negative clearance, or a number beyond 1e6 m.
    """

    center: FloatArray
    """(3,) [m], read-only"""
    half_extents: FloatArray
    """(3,) [m], > 0, along the box's own axes, read-only"""
    quaternion: FloatArray = field(default_factory=lambda: np.array([0.0, 0.0, 0.0, 1.0]))
    """box axes in the initial camera frame (4,), (x, y, z, w), unit, read-only; default: the same"""
    clearance: float | None = None
    """what the camera centre keeps from its surface [m]; None: the problem's clearance"""
    motion: FloatArray | None = None
    """displacement at w (3, k+1), highest power first [m], k ≤ 16, read-only; None: it stands still"""

    FIELDS: ClassVar = {"center": "center", "quaternion": "quaternion", "half_extents": "half_extents"}

    __repr__ = short_repr
    __setstate__ = frozen_again

    def __post_init__(self) -> None:
        object.__setattr__(self, "center", bounded_array("center", self.center, (3,)))
        extents = bounded_array("half_extents", self.half_extents, (3,))
        if not np.all(extents > 0.0):
            raise InputError(f"half_extents: {extents.tolist()} given; legal: > 0 each")
        object.__setattr__(self, "half_extents", extents)
        object.__setattr__(self, "quaternion", unit_vector("quaternion", self.quaternion, 4))
        object.__setattr__(self, "clearance", own_clearance(self.clearance))
        object.__setattr__(self, "motion", own_motion(self.motion))

    @property
    def core(self) -> Core:
        """What the proof separates from the path."""
        return Core(self.center, axes_of(self.quaternion), self.half_extents)

    def distance(self, points: FloatArray) -> FloatArray:
        """Return the distance of points (k, 3) to the surface [m] (k,), negative inside.

        Where it stands without its motion.
        """
        beyond = np.abs(Rotation.from_quat(self.quaternion).apply(points - self.center, inverse=True))
        beyond -= self.half_extents
        outside = np.linalg.norm(np.maximum(beyond, 0.0), axis=1)
        return np.asarray(outside + np.minimum(beyond.max(axis=1), 0.0))

    def grown(self, metres: float) -> Self:
        """Return one that holds all within so many metres of it."""
        return replace(self, half_extents=self.half_extents + metres)
