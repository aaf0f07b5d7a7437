"""What a task may state in a frame of its choice."""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Mapping
from typing import Literal, Self

from scipy.spatial.transform import RigidTransform

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
