"""Where the joints have the camera."""

from __future__ import annotations

import numpy as np
from scipy.spatial.transform import RigidTransform

from omniservo.geometry.arrays import FloatArray
from omniservo.geometry.quaternions import quaternion_from_matrix
from omniservo.safety.supervised_robot import SupervisedRobot


class CameraMotion:
    """The camera's poses by the joints as they were measured, and then as what was sent leads on.

    Args:
        robot: with its history.
        start: times are counted from here [s].
    """

    def __init__(self, robot: SupervisedRobot, start: float) -> None:
        self._robot, self._start = robot, start
        self._flange_T_camera = robot.flange_T_camera.as_matrix()

    def __call__(self, time: float) -> FloatArray:
        """Return base_T_camera at ``time`` [s]: quaternion (x, y, z, w) and translation [m], (7,)."""
        place = self._base_T_camera(time)
        return np.concatenate((quaternion_from_matrix(np.ascontiguousarray(place[:3, :3])), place[:3, 3]))

    @property
    def until(self) -> float:
        """Until when what was sent is known to act: ``command_lag`` after the last reading [s]."""
        return self._robot.history.time + self._robot.options.command_lag - self._start

    def mean_twist(self, since: float, until: float) -> FloatArray:
        """Return the constant twist (6,) in the camera's frame that leads from one time's pose to another's.

        Linear [m/s] and angular [rad/s]; zero where the times [s] are the same.
        """
        if until <= since:
            return np.zeros(6)
        before, after = (self._base_T_camera(time) for time in (since, until))
        moved = RigidTransform(np.linalg.inv(before) @ after, normalize=False)
        turn_and_shift = moved.as_exp_coords() / (until - since)
        return np.concatenate((turn_and_shift[3:], turn_and_shift[:3]))

    def _base_T_camera(self, time: float) -> FloatArray:
        joints = self._robot.history.expected(np.array(self._start + time))
        place = np.zeros((4, 4))
        place[3, 3] = 1.0
        place[:3] = self._robot.arm.locate(joints)[0][:3] @ self._flange_T_camera
        return place
