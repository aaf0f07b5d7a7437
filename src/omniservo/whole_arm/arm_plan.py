"""A plan with the joints that carry it out."""

from __future__ import annotations

from dataclasses import dataclass

from omniservo.field_docs import with_field_docs
from omniservo.planning.plan import Plan
from omniservo.robots import ArmClearance, FollowedPath, JointPath


@with_field_docs
@dataclass(frozen=True, eq=False)
class ArmPlan:
    """A camera path, and what the arm makes of it."""

    plan: Plan
    """certified only where the arm can follow the path, too, and keeps clear of everything on it"""
    branch: JointPath | None
    """the joints along the path, as far as it goes; None: there is no path"""
    followed: FollowedPath | None
    """every branch that was tried for this path, ``branch`` among them; None: there is no path"""
    clearance: ArmClearance | None
    """of ``branch``; None: there is none, or it ends early"""
    seconds: float
    """time that all of it took [s]"""
    attempts: int
    """camera paths from different starts that were tried"""

    def __repr__(self) -> str:
        gap = "" if self.clearance is None else f", {self.clearance.status}"
        return f"ArmPlan({self.plan!r}{gap}, {self.attempts} camera paths tried, {self.seconds:.3g} s)"

    @property
    def certified(self) -> bool:
        """Whether camera path, joints and clearance are proven."""
        return self.plan.status == "certified"
