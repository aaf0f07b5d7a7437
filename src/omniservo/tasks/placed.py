"""A thing with a place."""

from __future__ import annotations

from typing import Self

import numpy as np
from scipy.spatial.transform import RigidTransform

from omniservo.tasks.framed import Framed
from omniservo.tasks.quantities import Point, PositiveLength
from omniservo.tasks.turned import Turned


class Placed(Turned):
    """Its middle, and how its axes are turned in the frame that its place is stated in."""

    center: Point
    """[m]"""

    @property
    def transform(self) -> RigidTransform:
        """From its own frame to the one that its place is stated in."""
        return RigidTransform.from_components(np.asarray(self.center), self.rotation)

    def transformed(self, a_T_b: RigidTransform) -> Self:
        """Return the same, stated in frame b, in frame a."""
        pose = a_T_b * self.transform
        return self.model_copy(
            update={
                "center": tuple(pose.translation.tolist()),
                "quaternion": None,
                "rotation_vector": tuple(pose.rotation.as_rotvec().tolist()),
            }
        )


class Block(Placed):
    """A box."""

    half_extents: tuple[PositiveLength, PositiveLength, PositiveLength]
    """[m]"""


class FramedBlock(Block, Framed):
    """A box, stated in a frame of the task's choice."""
