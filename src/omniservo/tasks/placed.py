"""A thing with a place."""

from __future__ import annotations

from typing import Self

import numpy as np
from scipy.spatial.transform import RigidTransform, Rotation

from omniservo.tasks.framed import Framed
from omniservo.tasks.quantities import Angle, Point, PositiveLength
from omniservo.tasks.section import Section


class Placed(Section):
    """Its middle, and how its axes are turned."""

    center: Point
    """[m]"""
    rotation_vector: tuple[Angle, Angle, Angle] = (0.0, 0.0, 0.0)
    """of its axes in the frame that its place is stated in: axis times angle [rad]"""

    @property
    def transform(self) -> RigidTransform:
        """From its own frame to the one that its place is stated in."""
        return RigidTransform.from_components(
            np.asarray(self.center), Rotation.from_rotvec(np.asarray(self.rotation_vector))
        )

    def transformed(self, a_T_b: RigidTransform) -> Self:
        """Return the same, stated in frame b, in frame a."""
        pose = a_T_b * self.transform
        return self.model_copy(
            update={
                "center": tuple(pose.translation.tolist()),
                "rotation_vector": tuple(pose.rotation.as_rotvec().tolist()),
            }
        )


class Block(Placed):
    """A box."""

    half_extents: tuple[PositiveLength, PositiveLength, PositiveLength]
    """[m]"""


class FramedBlock(Block, Framed):
    """A box, stated in a frame of the task's choice."""
