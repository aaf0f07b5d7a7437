"""Whether the robot could still be braked in time: inside its joint ranges, inside its workspace."""

from __future__ import annotations

import numpy as np
from scipy.spatial.transform import RigidTransform

from omniservo.errors import JointLimit, WorkspaceLimit
from omniservo.geometry.arrays import FloatArray
from omniservo.robots import Arm, RobotState
from omniservo.robots.kinematics.twist_matrix import twist_matrix
from omniservo.safety.motion_limits import stopping_distance
from omniservo.safety.safety_options import SafetyOptions

RUNAWAY = 1.25
"""A joint measured to turn faster than this times its speed limit does not do what it is commanded."""


class Stoppable:
    """Refuses velocities after which braking, begun within the reaction time, would end too late.

    Args:
        arm: its kinematics and limits.
        flange_T_camera: how the camera sits on it.
        base_T_found: the camera in the base frame, where the supervisor found the robot.
        options: reaction time, reserve and workspace.
    """

    def __init__(
        self,
        arm: Arm,
        flange_T_camera: RigidTransform,
        base_T_found: RigidTransform,
        options: SafetyOptions,
    ) -> None:
        self._arm, self._options = arm, options
        box = options.found_T_workspace
        base_T_box = base_T_found if box is None else base_T_found * box
        self._box_T_base = base_T_box.inv().as_matrix()[:3]
        self._flange_T_camera = flange_T_camera.as_matrix()
        self._to_camera = twist_matrix(flange_T_camera)[:3]
        self._runaway = RUNAWAY * arm.joint_speed
        self._low = arm.joint_range[:, 0] + options.joint_reserve
        self._high = arm.joint_range[:, 1] - options.joint_reserve

    def check(self, state: RobotState, velocities: FloatArray) -> None:
        """Pass velocities (n,) [rad/s], or say why not.

        Raises:
            JointLimit: a joint that goes outwards would leave its range, or turns faster than it may.
            WorkspaceLimit: the camera's centre, going outwards, would leave the workspace.
        """
        self._refuse_runaway(state)
        self._refuse_range(state, velocities)
        self._refuse_workspace(state, velocities)

    def _refuse_runaway(self, state: RobotState) -> None:
        speed = np.abs(state.joint_velocities)
        if np.count_nonzero(speed > self._runaway):  # any() takes several times as long
            j = int(np.argmax(speed / self._arm.joint_speed))
            raise JointLimit(
                f"{self._arm.joint_names[j]} turns with "
                f"{np.rad2deg(abs(state.joint_velocities[j])):.0f} deg/s; "
                f"at most {np.rad2deg(self._arm.joint_speed[j]):.0f} deg/s was allowed"
            )

    def _refuse_range(self, state: RobotState, velocities: FloatArray) -> None:
        """Stop when a joint that goes outwards could not be braked inside its range any more."""
        arm, options, measured = self._arm, self._options, state.joint_velocities
        up = velocities > 0.0
        worst = np.where(up, np.maximum(velocities, measured), np.minimum(velocities, measured))
        end = state.joint_positions + stopping_distance(worst, arm.joint_acceleration, options.reaction)
        leaving = (up & (end > self._high)) | ((velocities < 0.0) & (end < self._low))
        if np.count_nonzero(leaving):
            j = int(np.argmax(leaving))
            raise JointLimit(
                f"{arm.joint_names[j]} at {np.rad2deg(state.joint_positions[j]):.1f} deg, turning with "
                f"{np.rad2deg(worst[j]):.1f} deg/s, would stop at {np.rad2deg(end[j]):.1f} deg; its range is "
                f"{np.rad2deg(arm.joint_range[j, 0]):.1f} … {np.rad2deg(arm.joint_range[j, 1]):.1f} deg, "
                f"{np.rad2deg(options.joint_reserve):.1f} deg of it held back"
            )

    def _refuse_workspace(self, state: RobotState, velocities: FloatArray) -> None:
        """Stop when the camera's centre, going outwards, could not be braked inside the workspace."""
        box = self._options.workspace
        if box is None or not np.count_nonzero(velocities):
            return
        base_T_flange, jacobian = self._arm.locate(state.joint_positions)
        box_R_base = self._box_T_base[:, :3]
        base_T_camera = base_T_flange @ self._flange_T_camera
        along = box_R_base @ base_T_camera[:, :3] @ (self._to_camera @ jacobian)
        centre = box_R_base @ base_T_camera[:, 3] + self._box_T_base[:, 3]
        speed = along @ velocities
        # What was commanded, and what turns on faster than that. Braking, the joints do not come to rest
        # together: on the way only some may have moved.
        both = np.stack([velocities, state.joint_velocities])
        turns = stopping_distance(both, self._arm.joint_acceleration, 0.0)
        ways = along[:, None] * turns  # (3, 2, n)
        reached = centre[:, None] + along @ both.T * self._options.reaction
        lowest = reached.min(axis=1) + np.minimum(ways, 0.0).min(axis=1).sum(axis=1)
        highest = reached.max(axis=1) + np.maximum(ways, 0.0).max(axis=1).sum(axis=1)
        leaving = ((speed < 0.0) & (lowest < box[0])) | ((speed > 0.0) & (highest > box[1]))
        if np.count_nonzero(leaving):
            i = int(np.argmax(leaving))
            end = lowest[i] if speed[i] < 0.0 else highest[i]
            raise WorkspaceLimit(
                f"the camera at {'xyz'[i]} = {centre[i]:.3f} m, moving with {speed[i]:.3f} m/s, could stop "
                f"only at {end:.3f} m; its workspace is {box[0, i]:g} … {box[1, i]:g} m"
            )
