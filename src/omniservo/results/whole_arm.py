"""What the whole arm kept of its clearance, as proven and as executed."""

from __future__ import annotations

from dataclasses import dataclass

from omniservo.geometry.arrays import FloatArray
from omniservo.risk import LinkMargin
from omniservo.robots import ArmClearance, Tube


@dataclass(frozen=True, eq=False)
class WholeArm:
    """Every link and the camera's housing among what the planner knows to stand around."""

    proof: ArmClearance
    """of the planned joints, between samples too"""
    asked: float | None
    """of the links as executed [m]; None: obstacles count for the camera alone"""
    margin: LinkMargin | None
    """what mount and estimate take of the gaps, where the task states a risk"""
    tube: Tube | None
    """what the arm deviates, where the task names a tube; the proof keeps it beyond"""
    planned: dict[str, FloatArray]
    """smallest gap by link where the plan is at each row of the log (m,) [m]"""
    executed: dict[str, FloatArray]
    """the same of the joints as read (m,) [m]"""
    notices: tuple[str, ...]
    """which shapes are not kept off each other, and why"""

    def least(self, gaps: dict[str, FloatArray]) -> float | None:
        """Return the smallest of these gaps [m]; None where there is none."""
        return min((float(column.min()) for column in gaps.values() if len(column)), default=None)
