"""Replanning: from the present pose and velocity, near the rest of the old path."""

from omniservo.replanning.replan import replan
from omniservo.replanning.replan_with_arm import replan_with_arm

__all__ = ["replan", "replan_with_arm"]
