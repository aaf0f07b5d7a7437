"""The planning problem of a task, once motion and structure are known."""

from __future__ import annotations

from typing import Literal

import numpy as np

from omniservo.errors import AnswerIsNo
from omniservo.estimation import TwoViewEstimate
from omniservo.planning import Degrees, Plan, PlanningProblem, Workspace, plan_path
from omniservo.tasks import Task


def problem_of(task: Task, estimate: TwoViewEstimate) -> PlanningProblem:
    """Return the problem: estimated goal and points, the task's obstacles, clearance plus tracking margin.

    An obstacle with a clearance of its own keeps it: the tracking margin widens the common one.

    Raises:
        AnswerIsNo: the estimate holds no pose.
    """
    planning = task.planning
    pose = estimate.initial_T_goal
    if pose is None:
        raise AnswerIsNo(f"no goal pose to plan to: {estimate.status}")
    workspace = planning.workspace
    return PlanningProblem(
        camera=task.camera,
        points=estimate.points,
        initial_T_goal=pose,
        obstacles=tuple(section.obstacle for section in planning.obstacles),
        clearance=planning.clearance + planning.tracking_margin,
        least_distance=planning.least_distance,
        visibility_margin=planning.visibility_margin,
        occlusion=planning.occlusion,
        workspace=None if workspace is None else Workspace(np.array(workspace.min), np.array(workspace.max)),
        degrees=Degrees(planning.degrees.rotation, planning.degrees.translation),
    )


def plan_task(
    task: Task, estimate: TwoViewEstimate, method: Literal["certified", "paper"], seed: int
) -> Plan:
    """Return the plan to follow.

    The paper's method promises nothing between its samples, so its path is followed whatever the
    certificate says of it.

    Raises:
        AnswerIsNo: there is no path to follow.
    """
    plan = plan_path(problem_of(task, estimate), method=method, seed=seed)
    if plan.path is None or (method == "certified" and plan.status != "certified"):
        raise AnswerIsNo(f"no path: {plan.status}: {plan.reason}")
    return plan
