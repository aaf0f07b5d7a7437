"""The planning problem of a task, once motion and structure are known."""

from __future__ import annotations

from typing import Any, Literal

from omniservo.errors import AnswerIsNo
from omniservo.estimation import TwoViewEstimate
from omniservo.planning import Plan, PlanningProblem, plan_path
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
    problem: dict[str, Any] = {
        "format": "omniservo.problem/1",
        "camera": task.camera.to_dict(),
        "points": estimate.points.tolist(),
        "goal": {"translation": pose.translation.tolist(), "quaternion": pose.rotation.as_quat().tolist()},
        "obstacles": [
            {"type": "sphere", "center": list(o.center), "radius": o.radius}
            | ({} if o.clearance is None else {"clearance": o.clearance})
            for o in planning.obstacles
        ],
        "clearance": planning.clearance + planning.tracking_margin,
        "least_distance": planning.least_distance,
        "visibility_margin": planning.visibility_margin,
        "occlusion": planning.occlusion,
        "degrees": planning.degrees.model_dump(),
    }
    if planning.workspace is not None:
        problem["workspace"] = {"min": list(planning.workspace.min), "max": list(planning.workspace.max)}
    return PlanningProblem.from_dict(problem)


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
