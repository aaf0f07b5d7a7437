"""Which of the estimated points a task's plan and servo have."""

from __future__ import annotations

import numpy as np

from omniservo.estimation import TwoViewEstimate
from omniservo.geometry.arrays import FloatArray, IntArray
from omniservo.looks.followed_points import followed_points, shown_at_ends
from omniservo.runs.plan_task import problem_of
from omniservo.tasks import Task


def followed_of(task: Task, estimate: TwoViewEstimate, pixels: FloatArray) -> IntArray:
    """Return the rows (m,) of the points to follow (`followed_points`), given their (n, 2) pixels [px]."""
    pose, points = estimate.initial_T_goal, estimate.points
    if pose is None:
        return np.empty(0, dtype=np.int64)
    shown = shown_at_ends(problem_of(task, pose, points[estimate.inliers]), estimate)
    return followed_points(estimate, pixels, shown)
