"""Motion and structure of a task's two pictures, made metric by the task's scale."""

from __future__ import annotations

import numpy as np

from omniservo.errors import AnswerIsNo, InputError
from omniservo.estimation import TwoViewEstimate, estimate_two_view
from omniservo.geometry.arrays import FloatArray
from omniservo.simulation.run_result import Seen
from omniservo.simulation.scene import Scene
from omniservo.tasks import Task, TaughtGoal

TwoViewScale = float | tuple[tuple[int, int], float]
"""As `estimate_two_view` takes it."""


def estimate_task(
    task: Task, scene: Scene, seen: Seen, goal: TaughtGoal, joints: FloatArray
) -> TwoViewEstimate:
    """Return the metric estimate of goal pose and target.

    Args:
        task: its scale says what makes the estimate metric.
        scene: the arm's kinematics, for ``odometry``.
        seen: the matched points.
        goal: with the arm's joints, where ``odometry`` is the scale.
        joints: (6,) the arm's joints at the initial picture [rad].

    Raises:
        InputError: the scale names dots that are not there, or needs joints that the goal does not hold.
        AnswerIsNo: the pictures do not determine the motion.
    """
    scale = _scale(task, scene, goal, joints)
    matched = seen.matched
    if isinstance(scale, tuple) and max(scale[0]) >= len(matched):
        raise InputError(
            f"scale.known_length.dots: {scale[0]} given; {len(matched)} dots are matched, "
            "numbered from 0, top to bottom, then left to right in the initial picture"
        )
    estimate = estimate_two_view(task.camera, matched.initial, matched.goal, scale=scale)
    if estimate.status != "ok":
        raise AnswerIsNo(f"motion and structure cannot be estimated: {estimate.status}: {estimate.message}")
    return estimate


def _scale(task: Task, scene: Scene, goal: TaughtGoal, joints: FloatArray) -> TwoViewScale:
    if task.scale.displacement is not None:
        return task.scale.displacement
    if task.scale.known_length is not None:
        return task.scale.known_length.dots, task.scale.known_length.length
    if goal.joints is None:
        raise InputError("scale.odometry: the taught goal holds no joints; give a displacement or a length")
    moved = scene.world_T_camera(goal.joints).translation - scene.world_T_camera(joints).translation
    return float(np.linalg.norm(moved))
