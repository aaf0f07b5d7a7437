"""The whole arm's clearance on a run: proven of the plan, measured of the joints that were read."""

from __future__ import annotations

from itertools import pairwise

import numpy as np

from omniservo.geometry.arrays import FloatArray
from omniservo.planning import Plan
from omniservo.results.run_log import RunLog
from omniservo.results.whole_arm import WholeArm
from omniservo.risk import RiskPlan
from omniservo.robots import arm_clearance, link_gaps
from omniservo.runs.arm_setting_of import arm_setting_of
from omniservo.scenes.scene import Scene
from omniservo.tasks import Task
from omniservo.tracking.followed_way import FollowedWay
from omniservo.tracking.planned_motion import PlannedMotion


def whole_arm_of(
    task: Task,
    scene: Scene,
    plan: Plan | None,
    risk: RiskPlan | None,
    motion: PlannedMotion | None,
    way: FollowedWay | None,
    log: RunLog,
) -> WholeArm | None:
    """Return what is proven of the planned joints, and each link's gaps on the way; None without a plan.

    Gaps are those to the obstacles where they are known to be at each row of the log.
    """
    if plan is None or motion is None or way is None:
        return None
    setting = arm_setting_of(task, scene)
    bodies = setting.bodies(plan.problem.obstacles)
    margin = None if risk is None else risk.links
    kept = setting.clearance_around + (0.0 if margin is None else margin.added)
    proof = arm_clearance(bodies, motion.joints, clearance=kept, self_clearance=setting.self_clearance)
    times = log.column("time")
    none = np.zeros((0, scene.arm.dof))
    planned, executed = (way.joints_at(times), log.column("joints")) if log.rows else (none, none)

    def gaps(joints: FloatArray) -> dict[str, FloatArray]:
        parts = []
        for begin, end in pairwise([-np.inf, *sorted({move.time for move in task.moves}), np.inf]):
            known = tuple(section.obstacle for section in task.known_obstacles(begin))
            there = bodies if begin == -np.inf else setting.bodies(known)
            parts.append(link_gaps(there, joints[(times >= begin) & (times < end)]))
        return {link: np.concatenate([part[link] for part in parts]) for link in parts[0]}

    return WholeArm(
        proof=proof,
        asked=task.planning.arm_clearance,
        margin=margin,
        tube=setting.tube,
        planned=gaps(planned),
        executed=gaps(executed),
        notices=(*scene.arm.notices, *bodies.notices),
    )
