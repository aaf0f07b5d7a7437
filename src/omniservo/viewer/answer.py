"""What the planner says of a situation: what the page shows."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Literal

import numpy as np
from scipy.spatial.transform import RigidTransform

from omniservo.errors import InputError
from omniservo.geometry.arrays import FloatArray
from omniservo.planning import Plan
from omniservo.risk import RiskPlan
from omniservo.viewer.situation import Situation
from omniservo.viewer.worst_place import WorstPlace, worst_place
from omniservo.whole_arm import ArmPlan

Verdict = Literal["certified", "no path", "searching"]


@dataclass(frozen=True, eq=False)
class Answer:
    """A plan for a situation, of the camera alone or with the arm.

    Of the whole arm there are two: the camera's plan at once, and the arm's when it is found.
    """

    number: int
    """of the update of the page"""
    situation: Situation
    camera_plan: Plan
    arm_plan: ArmPlan | None = None
    risk_plan: RiskPlan | None = None
    """where the situation has a risk: the plan that may be trusted with it"""
    searching: bool = False
    """the arm's plan is still searched for"""
    request: int = 0
    """number of the newest change that it takes into account"""

    @property
    def plan(self) -> Plan:
        """What is shown: the plan at a risk where there is one, else the arm's."""
        if self.risk_plan is not None:
            return self.risk_plan.plan
        return self.camera_plan if self.arm_plan is None else self.arm_plan.plan

    @property
    def verdict(self) -> Verdict:
        """Certified only where the planner says so, of all that is planned for."""
        if self.plan.status == "certified":
            return "searching" if self.searching else "certified"
        return "searching" if self.searching and self.camera_plan.status == "certified" else "no path"

    @property
    def camera_alone(self) -> bool:
        """Whether this much is certified: the camera's path, for which the arm's plan is just begun."""
        begun = self.searching and self.arm_plan is None and not self.situation.risk
        return begun and self.camera_plan.status == "certified"

    @property
    def reason(self) -> str:
        """Why there is no path; empty where there is one."""
        return "" if self.verdict == "certified" else self.plan.reason

    @cached_property
    def worst(self) -> WorstPlace | None:
        """The tightest constraint, or the worst violation."""
        return worst_place(self.situation, self.plan, self.arm_plan)

    @property
    def end(self) -> float:
        """How far the shown path can be followed: w of the end of the arm's branch, else 1."""
        branch = None if self.arm_plan is None else self.arm_plan.branch
        return 1.0 if branch is None else float(branch.w[-1])

    def world_T_camera(self, w: float) -> RigidTransform:
        """Return the camera at w; without a path the end pose that is nearer."""
        if self.plan.path is None:
            return self.situation.world_T_goal if w > 0.5 else self.situation.world_T_initial
        return self.situation.world_T_initial * self.plan.path(w)

    def places(self, count: int) -> FloatArray:
        """Return the camera's way (count, 3) in the world [m]; straight where there is none."""
        w = np.linspace(0.0, 1.0, count)
        if self.plan.path is None:
            there = self.situation.problem.initial_T_goal.translation
            return self.situation.world_T_initial.apply(w[:, None] * there)
        return self.situation.world_T_initial.apply(self.plan.path.positions(w))

    def joints(self, w: float) -> FloatArray | None:
        """Return the arm's joints (n,) at w [rad]; None: there is no arm, or it does not get there.

        Along the arm's own plan where there is one, else those near the start's that put the camera there.
        """
        arm = self.situation.arm
        if arm is None:
            return None
        branch = None if self.arm_plan is None else self.arm_plan.branch
        if branch is not None and w <= branch.w[-1]:
            return branch(w)
        try:
            return arm.scene.joints_for(self.world_T_camera(w), arm.scene.start_joints)
        except InputError:
            return None
