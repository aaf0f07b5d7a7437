"""The whole arm's clearance on a run: proven of the plan, measured of the joints that were read."""

from __future__ import annotations

import numpy as np

from omniservo.planning import Plan, mount_margin
from omniservo.robots import arm_clearance, link_gaps
from omniservo.runs.arm_setting_of import arm_setting_of
from omniservo.simulation.planned_motion import PlannedMotion
from omniservo.simulation.run_log import RunLog
from omniservo.simulation.scene import Scene
from omniservo.simulation.whole_arm import WholeArm
from omniservo.tasks import Task


def whole_arm_of(
    task: Task, scene: Scene, plan: Plan | None, motion: PlannedMotion | None, log: RunLog
) -> WholeArm | None:
    """Return what is proven of the planned joints, and each link's gaps on the way; None without a plan."""
    if plan is None or motion is None:
        return None
    setting = arm_setting_of(task, scene)
    bodies = setting.bodies(plan.problem.obstacles)
    covariance, risk, for_mount = task.arm.mount_covariance, task.planning.risk, 0.0
    if covariance is not None and risk is not None and plan.path is not None:
        for_mount = mount_margin(setting, bodies, plan.path, motion.joints, np.array(covariance), risk)
    kept = setting.clearance_around + for_mount
    proof = arm_clearance(bodies, motion.joints, clearance=kept, self_clearance=setting.self_clearance)
    rows = log.rows
    planned = motion.joints(np.clip(log.column("w"), 0.0, 1.0)) if rows else np.zeros((0, scene.arm.dof))
    executed = log.column("joints") if rows else planned
    return WholeArm(
        proof, task.planning.arm_clearance, for_mount, link_gaps(bodies, planned), link_gaps(bodies, executed)
    )
