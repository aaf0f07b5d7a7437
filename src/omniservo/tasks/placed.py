"""What has a place: the frame that it is stated in, how it is turned, where it is."""

from __future__ import annotations

import math
from abc import abstractmethod
from collections.abc import Mapping
from typing import Literal, Self

import numpy as np
from pydantic import model_validator
from scipy.spatial.transform import RigidTransform, Rotation

from omniservo.planning.checks import NEAR_UNIT
from omniservo.tasks.quantities import Angle, Point, PositiveLength, Real
from omniservo.tasks.section import Section

Frame = Literal["initial", "base", "goal"]
"""initial: the initial camera frame. base: the arm's, as its controller reports places. goal: that of the
camera where the goal is taught"""


class Framed(Section):
    """A thing with a place; once the task is read, in the initial camera frame."""

    frame: Frame = "initial"
    """in which its place and its directions are stated"""

    def in_initial(self, initial_T: Mapping[Frame, RigidTransform]) -> Self:
        """Return it stated in the initial camera frame; ``initial_T``: every frame as seen from there."""
        if self.frame == "initial":
            return self
        return self.transformed(initial_T[self.frame]).model_copy(update={"frame": "initial"})

    @abstractmethod
    def transformed(self, a_T_b: RigidTransform) -> Self:
        """Return the same, stated in frame b, in frame a."""


class Turned(Section):
    """A rotation: a unit quaternion or a rotation vector; without either nothing is turned."""

    quaternion: tuple[Real, Real, Real, Real] | None = None
    """(x, y, z, w), unit within 1e-6"""
    rotation_vector: tuple[Angle, Angle, Angle] | None = None
    """axis times angle [rad]"""

    @model_validator(mode="after")
    def _one_rotation(self) -> Turned:
        if self.quaternion is not None and self.rotation_vector is not None:
            raise ValueError("give quaternion or rotation_vector, not both")
        if self.quaternion is not None and abs(math.hypot(*self.quaternion) - 1.0) > NEAR_UNIT:
            raise ValueError(f"quaternion has norm {math.hypot(*self.quaternion):g}; it must be 1")
        return self

    @property
    def rotation(self) -> Rotation:
        """It as SciPy's Rotation."""
        if self.quaternion is not None:
            return Rotation.from_quat(self.quaternion)
        return Rotation.from_rotvec(self.rotation_vector or (0.0, 0.0, 0.0))


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
