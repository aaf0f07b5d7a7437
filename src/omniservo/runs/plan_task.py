"""The planning problem of a task, once motion and structure are known."""

from __future__ import annotations

from typing import Literal

import numpy as np
from scipy.spatial.transform import RigidTransform

from omniservo.cameras.conversion import to_unified
from omniservo.errors import NoSolutionError
from omniservo.estimation import TwoViewEstimate
from omniservo.geometry.arrays import FloatArray, IntArray
from omniservo.planning import Degrees, Plan, PlanningProblem, plan_path, widened_evenly
from omniservo.risk import RiskPlan, plan_arm_with_risk
from omniservo.runs.arm_setting_of import TRACKING_PART, arm_setting_of, tube_of
from omniservo.runs.no_path import NoPath
from omniservo.scenes.scene import Scene
from omniservo.tasks import Task
from omniservo.whole_arm import plan_with_arm


def problem_of(task: Task, initial_T_goal: RigidTransform, points: FloatArray) -> PlanningProblem:
    """Return the problem of goal and points (n, 3) [m] as estimated, as a tracking tube widens it."""
    problem, tube = problem_without_tube(task, initial_T_goal, points), tube_of(task)
    return problem if tube is None else widened_evenly(problem, tube.position, tube.image)


def problem_without_tube(task: Task, initial_T_goal: RigidTransform, points: FloatArray) -> PlanningProblem:
    """Return the same without what a tracking tube takes: clearance plus tracking margin.

    An obstacle with a clearance of its own keeps it: the tracking margin widens the common one.
    """
    planning = task.planning
    return PlanningProblem(
        camera=to_unified(task.camera).camera,
        points=points,
        initial_T_goal=initial_T_goal,
        obstacles=tuple(section.obstacle for section in planning.obstacles),
        clearance=planning.clearance + planning.tracking_margin,
        least_distance=planning.least_distance,
        visibility_margin=planning.visibility_margin,
        occlusion=planning.occlusion,
        workspace=None if planning.workspace is None else planning.workspace.workspace,
        degrees=Degrees(planning.degrees.rotation, planning.degrees.translation),
    )


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
        risk = plan_arm_with_risk(
            problem, setting, estimate, risk=risk_of_plan(task), points=followed, seed=seed,
            mount_covariance=mount_covariance_of(task),
        )  # fmt: skip
        plan = risk.plan
    if plan.path is None or (method == "certified" and plan.status != "certified"):
        raise NoPath(plan, scene, setting, found, risk)
    return plan, risk


def risk_of_plan(task: Task) -> float:
    """Return the part of a task's risk that is the estimate's and the mount's; 0 where it states none."""
    return (task.planning.risk or 0.0) * (1.0 if task.planning.tracking_tube is None else 1.0 - TRACKING_PART)


def mount_covariance_of(task: Task) -> FloatArray | None:
    """Return that of flange_T_camera as the task states it; None: exact."""
    mount = task.arm.mount_covariance
    return None if mount is None else np.array(mount)
