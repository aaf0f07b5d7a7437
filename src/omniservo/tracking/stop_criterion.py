"""When the camera counts as arrived: in px, and in pose."""

from collections import deque

import numpy as np

from omniservo.geometry.arrays import FloatArray
from omniservo.tracking.tracker_options import TrackerOptions


class StopCriterion:
    """Holds after ``settled_frames`` frames in a row near the goal image, if their mean pose is near too.

    The pose is averaged because one image's is noisy: 0.03 px on nine dots that span ±10° is 0.7 mm.

    Args:
        goal_pose: (7,) quaternion (x, y, z, w) and translation [m] of initial_T_camera at the goal image.
        options: the tolerances.
    """

    def __init__(self, goal_pose: FloatArray, options: TrackerOptions) -> None:
        self._goal = goal_pose
        self._options = options
        self._gaps: deque[FloatArray] = deque(maxlen=options.settled_frames)
        self._time = -np.inf

    def restart(self) -> None:
        """Drop the frames so far."""
        self._gaps.clear()

    def holds(self, time: float, goal_error_px: float, pose: FloatArray) -> bool:
        """Take one frame in and return whether the camera counts as arrived.

        A frame taken at the same ``time`` [s] as the last is that image again and does not count twice.
        """
        if not goal_error_px <= self._options.tolerance_px:  # nor is NaN near
            self._gaps.clear()
        elif time > self._time or not self._gaps:
            self._gaps.append(self._gap(pose))
        self._time = time
        if len(self._gaps) < self._options.settled_frames:
            return False
        gap = np.mean(self._gaps, axis=0)
        near = np.linalg.norm(gap[:3]) <= self._options.tolerance_m
        return bool(near and np.linalg.norm(gap[3:]) <= self._options.tolerance_rad)

    def _gap(self, pose: FloatArray) -> FloatArray:
        """Return translation [m] and small rotation vector [rad] from the goal pose, (6,)."""
        q, g = pose[:4], self._goal[:4]
        vector = g[3] * q[:3] - q[3] * g[:3] - np.cross(g[:3], q[:3])
        turn = 2.0 * np.copysign(1.0, q @ g) * vector
        return np.concatenate((pose[4:] - self._goal[4:], turn))
