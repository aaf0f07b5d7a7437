"""A task that is refused at planning, with what an image of it needs."""

from __future__ import annotations

import numpy as np

from omniservo.errors import InputError, NoSolutionError
from omniservo.geometry.arrays import FloatArray
from omniservo.planning import Plan
from omniservo.risk import RiskPlan
from omniservo.scenes.scene import Scene
from omniservo.whole_arm import ArmPlan, ArmSetting


class NoPath(NoSolutionError):
    """There is no path to follow."""

    def __init__(
        self,
        plan: Plan,
        scene: Scene,
        setting: ArmSetting,
        found: ArmPlan | None,
        risk: RiskPlan | None = None,
    ) -> None:
        """Keep what was planned; ``found``: with what the arm made of it, ``risk``: at a risk, if any."""
        super().__init__(f"no path: {plan.status}: {plan.reason}")
        self.plan, self.scene, self.setting, self.risk = plan, scene, setting, risk
        self.posture = scene.start_joints if found is None else _posture(found, setting, scene)
        """(n,) the arm where it fails, as far as that is known [rad]"""


def _posture(found: ArmPlan, setting: ArmSetting, scene: Scene) -> FloatArray:
    branch, closest = found.branch, None if found.clearance is None else found.clearance.closest
    if branch is not None and branch.failures:
        return np.asarray(branch(branch.failures[0].w))
    if branch is not None and closest is not None:
        return np.asarray(branch(closest.w))
    if found.plan.reason.startswith("the goal"):
        goal = setting.base_T_flange(found.plan.problem.initial_T_goal)
        try:
            return scene.arm.inverse_near(goal, scene.start_joints)
        except InputError:  # out of reach
            pass
    return scene.start_joints
