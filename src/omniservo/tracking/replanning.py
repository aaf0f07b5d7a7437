"""What came of one look at what has changed."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

from omniservo.field_docs import with_field_docs
from omniservo.planning import Plan, PlanningProblem
from omniservo.robots import JointPath
from omniservo.tracking.leg import Leg


@with_field_docs
@dataclass(frozen=True, eq=False)
class Replanning:
    """One look at what has changed."""

    time: float
    """of the image after which it was made, since the servo's start [s]"""
    cause: Literal["obstacles", "estimate"]
    outcome: Literal["kept", "replanned", "blocked"]
    """kept: the way is still proven. replanned: another one is. blocked: none is; the robot is stopped"""
    w: float
    """where the way is left, or the robot was"""
    problem: PlanningProblem
    """what was known then, in the plan's frame"""
    seconds: float
    """that it took [s]"""
    reason: str = ""
    """why no way on is proven; else empty"""
    legs: tuple[Leg, ...] = ()
    """what was entered: the new way, and before it the old one slowed down if need be; none unless
    replanned"""
    joints: tuple[JointPath | None, ...] = ()
    """that follow each"""
    plan: Plan | None = None
    """certified, in the camera frame where the old way is left; None unless replanned"""

    @property
    def leg(self) -> Leg | None:
        """The new way; None unless replanned."""
        return self.legs[-1] if self.legs else None
