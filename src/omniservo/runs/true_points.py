"""Where the followed points truly are: for scoring and for the report only."""

from __future__ import annotations

import numpy as np

from omniservo.geometry.arrays import FloatArray
from omniservo.runs.ground_truth import GroundTruth
from omniservo.tasks import Task


def true_points(task: Task, truth: GroundTruth, joints: FloatArray, initial_pixels: FloatArray) -> FloatArray:
    """Return the points (n, 3) [m], initial camera frame, that the initial image shows at pixels (n, 2).

    It was taken in ``joints`` (n,) [rad].

    A dot's point is its centre; of any other target it is what the pixel's ray meets.
    """
    if not task.target.dots:
        seen = truth.points_under(joints, initial_pixels)
        return np.asarray(task.start.world_T_camera.transform.inv().apply(seen))
    centers = np.array([dot.center for dot in task.target.dots])
    pixels, _ = task.camera.project(centers)
    order = [int(np.nanargmin(np.linalg.norm(pixels - p, axis=1))) for p in initial_pixels]
    return np.asarray(centers[order])
