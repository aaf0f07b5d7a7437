"""The planning problem of a task, once motion and structure are known."""

from __future__ import annotations

from typing import Literal

import numpy as np
from scipy.spatial.transform import RigidTransform

from omniservo.cameras.conversion import to_unified
from omniservo.errors import NoSolutionError
from omniservo.estimation import TwoViewEstimate
from omniservo.geometry.arrays import FloatArray, IntArray
from omniservo.planning import Degrees, Plan, PlanningProblem, Workspace, plan_path, widened_evenly
from omniservo.risk import RiskPlan, plan_arm_with_risk
from omniservo.runs.arm_setting_of import TRACKING_PART, arm_setting_of, tube_of
from omniservo.runs.no_path import NoPath
from omniservo.scenes.scene import Scene
from omniservo.tasks import Task
from omniservo.whole_arm import plan_with_arm


def problem_of(task: Task, initial_T_goal: RigidTransform, points: FloatArray) -> PlanningProblem:
    """Return the problem of goal and points (n, 3) [m] as estimated: clearance plus tracking margin.

    An obstacle with a clearance of its own keeps it: the tracking margin widens the common one. A tracking
    tube widens all.
    """
    planning = task.planning
    workspace = planning.workspace
    problem = PlanningProblem(
        camera=to_unified(task.camera).camera,
        points=points,
        initial_T_goal=initial_T_goal,
        obstacles=tuple(section.obstacle for section in planning.obstacles),
        clearance=planning.clearance + planning.tracking_margin,
        least_distance=planning.least_distance,
        visibility_margin=planning.visibility_margin,
        occlusion=planning.occlusion,
        workspace=None if workspace is None else Workspace(np.array(workspace.min), np.array(workspace.max)),
        degrees=Degrees(planning.degrees.rotation, planning.degrees.translation),
    )
    tube = tube_of(task)
    return problem if tube is None else widened_evenly(problem, tube.position, tube.image)


def plan_task(
    task: Task,
    scene: Scene,
    estimate: TwoViewEstimate,
    followed: IntArray,
    method: Literal["certified", "paper"],
    seed: int,
) -> tuple[Plan, RiskPlan | None]:
    """Return the plan to follow, for the ``followed`` rows (m,) of the estimated points, and its risk.

    The paper's method promises nothing between its samples, so its path is followed whatever the
    certificate says of it; it knows neither risk nor arm.

    Raises:
        NoSolutionError: there is no path to follow.
    """
    pose = estimate.initial_T_goal
    if pose is None:
        raise NoSolutionError(f"no goal pose to plan to: {estimate.status}")
    problem, risk = problem_of(task, pose, estimate.points[followed]), None
    setting, found = arm_setting_of(task, scene), None
    if method == "paper":
        plan = plan_path(problem, method="paper", seed=seed)
    elif task.planning.risk is None:
        found = plan_with_arm(problem, setting, seed=seed)
        plan = found.plan
    else:
        left = task.planning.risk * (1.0 if task.planning.tracking_tube is None else 1.0 - TRACKING_PART)
        mount = task.arm.mount_covariance
        risk = plan_arm_with_risk(
            problem, setting, estimate, risk=left, points=followed, seed=seed,
            mount_covariance=None if mount is None else np.array(mount),
        )  # fmt: skip
        plan = risk.plan
    if plan.path is None or (method == "certified" and plan.status != "certified"):
        raise NoPath(plan, scene, setting, found)
    return plan, risk
