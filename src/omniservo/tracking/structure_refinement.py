"""The target's structure, refined as more views of it come."""

from __future__ import annotations

import numpy as np

from omniservo.cameras import UnifiedCamera
from omniservo.estimation.refinement.bundle_adjustment import adjust_views
from omniservo.geometry.arrays import BoolArray, FloatArray

BETWEEN_VIEWS = 0.1
"""The camera must have moved by this part of the way to the goal before another view is kept."""

MOST_VIEWS = 12
"""The initial and the goal image, and so many less two on the way."""

_INITIAL, _GOAL = 0, 1
_MOST_STEPS = 20


class StructureRefinement:
    """Keeps views along the way and refines all camera poses and points on them.

    The frame is that of the initial camera. The scale stays that of the given goal pose: images do not
    tell it.

    Args:
        camera: took all images.
        points: (n, 3) [m] as estimated, initial camera frame.
        initial_pixels: (n, 2) [px].
        goal_pixels: (n, 2) [px].
        goal_pose: (7,) quaternion (x, y, z, w) and translation [m] of initial_T_goal.
    """

    def __init__(
        self,
        camera: UnifiedCamera,
        points: FloatArray,
        initial_pixels: FloatArray,
        goal_pixels: FloatArray,
        goal_pose: FloatArray,
    ) -> None:
        self._parameters = camera.parameters
        self._points = points.copy()
        self._pixels = [np.array(initial_pixels), np.array(goal_pixels)]
        everything = np.ones(len(points), dtype=np.bool_)
        self._seen = [everything, everything]
        self._poses = [np.array([0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0]), np.array(goal_pose)]
        self._apart = BETWEEN_VIEWS * float(np.linalg.norm(goal_pose[4:]))
        # Once here, so that compiling does not delay a twist.
        views = np.array(self._pixels), np.array(self._seen)
        adjust_views(self._parameters, *views, _GOAL, 1, np.array(self._poses), points.copy())

    @property
    def views(self) -> int:
        """How many are kept."""
        return len(self._poses)

    def look(self, pixels: FloatArray, used: BoolArray, pose: FloatArray) -> FloatArray | None:
        """Take an image in; return the refined points (n, 3) [m], None where it adds nothing.

        Args:
            pixels: (n, 2) [px]; rows that are not used may hold anything.
            used: (n,) the points that were seen and belong.
            pose: (7,) of the camera, as estimated.
        """
        if len(self._poses) >= MOST_VIEWS:
            return None
        away = np.array(self._poses)[:, 4:] - pose[4:]
        if (away * away).sum(axis=1).min() < self._apart**2:
            return None
        poses = np.array([*self._poses, pose])
        points = self._points.copy()
        seen = np.array([*self._seen, used])
        views = np.array([*self._pixels, pixels])
        _, converged = adjust_views(self._parameters, views, seen, _GOAL, _MOST_STEPS, poses, points)
        if not converged:
            return None
        self._poses, self._points = list(poses), points
        self._pixels, self._seen = list(views), list(seen)
        return points.copy()
