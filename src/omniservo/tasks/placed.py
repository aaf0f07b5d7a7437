"""A thing with a place in the initial camera frame."""

from __future__ import annotations

import numpy as np
from scipy.spatial.transform import RigidTransform, Rotation

from omniservo.tasks.quantities import Angle, Point, PositiveLength
from omniservo.tasks.section import Section


class Placed(Section):
    """Its middle, and how its axes are turned."""

    center: Point
    """[m]"""
    rotation_vector: tuple[Angle, Angle, Angle] = (0.0, 0.0, 0.0)
    """of its axes in the initial camera frame: axis times angle [rad]"""

    @property
    def transform(self) -> RigidTransform:
        """From its own frame to the initial camera frame."""
        return RigidTransform.from_components(
            np.asarray(self.center), Rotation.from_rotvec(np.asarray(self.rotation_vector))
        )


class Block(Placed):
    """A box."""

    half_extents: tuple[PositiveLength, PositiveLength, PositiveLength]
    """[m]"""
