"""Scores of a run against the truth: the numbers of metrics.json."""

from __future__ import annotations

import numpy as np
from scipy.spatial.transform import RigidTransform, Rotation

from omniservo.geometry.arrays import FloatArray
from omniservo.planning import Plan
from omniservo.reporting import image_distance
from omniservo.reporting.curves import obstacle_distances
from omniservo.results.run_log import RunLog
from omniservo.results.run_result import Truth
from omniservo.tasks import Task
from omniservo.tracking.followed_way import FollowedWay


def score(
    task: Task, plan: Plan | None, way: FollowedWay | None, log: RunLog, truth: Truth | None
) -> dict[str, object]:
    """Return the metrics that compare the executed run with the truth, and with what the plan promised.

    Without truth, on a real robot, what was executed is what joints and images say.

    Lengths in m, angles in rad, pixels in px; None where a quantity does not exist.
    """
    positions = log.executed("position")
    return {
        "status": _status(log),
        "reason": f"{log.stop_reason}: {log.stop_message}" if log.stop_reason else "",
        "clearance_asked_m": task.planning.clearance,
        "clearance_planned_m": None if plan is None else plan.least_clearance(task.planning.common_obstacles),
        "clearance_executed_m": _least_clearance(task, log.column("time"), positions),
        "arm_clearance_executed_m": _least_arm_clearance(task, log),
        "visibility_planned_px": None if plan is None else plan.least_visibility(),
        "visibility_executed_px": _least_visibility(task, log),
        **_final_errors(log, truth),
        "path_deviation_m": _deviation(way, log),
        "servo_seconds": float(log.rows[-1].time) if log.rows else 0.0,
        "frames": len(log.rows),
        "lost_points": int(np.sum(log.column("valid") == 0)) if log.rows else 0,
        "filtered_frames": _filtered(log),
        "contacts": sorted(list(pair) for pair in log.contacts),
    }


def _least_arm_clearance(task: Task, log: RunLog) -> float | None:
    return float(np.min(log.column("arm_clearance"))) if log.has_truth and task.obstacles else None


def _filtered(log: RunLog) -> int:
    """How many commands the visibility filter changed."""
    return int(np.sum(log.column("filter_change").any(axis=1))) if log.rows else 0


def _status(log: RunLog) -> str:
    if log.contacts:
        return "contact"
    return "stopped" if log.stop_reason else "converged"


def _least_clearance(task: Task, times: FloatArray, positions: FloatArray) -> float | None:
    """Smallest distance of the camera centre to the surface of the obstacles that ask for a clearance."""
    if not task.planning.common_obstacles or not len(positions):
        return None
    distances = obstacle_distances(task, times, positions)
    return float(distances[:, task.planning.common_obstacles].min())


def _least_visibility(task: Task, log: RunLog) -> float | None:
    """Smallest distance of a dot to the image limits [px]; None where one left the camera's domain.

    Without truth: of those that were found.
    """
    if not log.rows:
        return None
    distances = image_distance(task.camera, log.executed("pixels"))
    least = float(np.min(distances if log.has_truth else distances[np.isfinite(distances)], initial=np.inf))
    least = least if least < np.inf else np.nan
    return None if np.isnan(least) else least


def _final_errors(log: RunLog, truth: Truth | None) -> dict[str, object]:
    """Pose error at the end against the taught pose, where that is known, and the image error as detected."""
    if not log.rows or truth is None:
        error = log.rows[-1].goal_error_px if log.rows else None
        return {"final_error_px": error, "final_translation_error_m": None, "final_rotation_error_rad": None}
    last = log.rows[-1]
    initial_T_camera = RigidTransform.from_components(
        last.true_position, Rotation.from_rotvec(last.true_rotation)
    )
    goal_T_camera = RigidTransform.from_matrix(truth.initial_T_goal).inv() * initial_T_camera
    return {
        "final_error_px": last.goal_error_px,
        "final_translation_error_m": float(np.linalg.norm(goal_T_camera.translation)),
        "final_rotation_error_rad": float(goal_T_camera.rotation.magnitude()),
    }


def _deviation(way: FollowedWay | None, log: RunLog) -> float | None:
    """Largest distance of the executed positions from the path that was followed [m]."""
    if way is None or not log.rows:
        return None
    planned = way.positions(1001)
    executed = log.executed("position")
    gaps = np.linalg.norm(executed[:, None, :] - planned[None, :, :], axis=2)
    return float(np.max(np.min(gaps, axis=1)))
