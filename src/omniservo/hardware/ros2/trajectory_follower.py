"""Follows joint trajectories as ros2_control's `joint_trajectory_controller` does, for stand-in servers."""

from __future__ import annotations

import numpy as np

from omniservo.geometry.arrays import FloatArray
from omniservo.ros_messages.messages import JointTrajectoryMessage


class TrajectoryFollower:
    """Holds the newest trajectory, and says where the joints are to be.

    Args:
        joint_names: the controller's joints.
    """

    def __init__(self, joint_names: tuple[str, ...]) -> None:
        self._names = joint_names
        self._times = np.zeros(0)
        self._rows = np.zeros((0, 2, len(joint_names)))

    def take(
        self,
        message: JointTrajectoryMessage,
        begin: float,
        now: float,
        positions: FloatArray,
        velocities: FloatArray,
    ) -> str:
        """Replace the trajectory by a new one; return why it was refused, or nothing.

        Args:
            message: the new one.
            begin: when it begins [s].
            now: the time [s].
            positions: the joints are to be there now (n,) [rad].
            velocities: and to go so fast (n,) [rad/s].
        """
        if sorted(message.joint_names) != sorted(self._names):
            return f"joints {message.joint_names}, and not {list(self._names)}"
        order = [message.joint_names.index(name) for name in self._names]
        count = len(order)
        if not message.points or any(
            len(p.positions) != count or len(p.velocities) != count for p in message.points
        ):
            return f"{len(message.points)} points, not all of {count} positions and velocities"
        times = np.array([begin + point.time_from_start.seconds for point in message.points])
        rows = np.array([[p.positions[order], p.velocities[order]] for p in message.points])
        if not np.isfinite(rows).all() or (np.diff(times) <= 0.0).any():
            return "numbers that are not finite, or times that do not increase"
        if rows[-1, 1].any():
            return "a trajectory that does not end at rest"
        if times[-1] < now:
            return f"a trajectory that ended {now - times[-1]:.3f} s ago"
        if times[0] > now:
            times = np.concatenate([[now], times])
            rows = np.concatenate([[np.array([positions, velocities])], rows])
        self._times, self._rows = times, rows
        return ""

    def at(self, time: float) -> tuple[FloatArray, FloatArray] | None:
        """Return positions (n,) [rad] and velocities (n,) [rad/s] at a time, by cubics; None before any."""
        if not len(self._times):
            return None
        if time >= self._times[-1]:
            return self._rows[-1, 0], np.zeros(len(self._names))
        k = int(np.clip(np.searchsorted(self._times, time, side="right") - 1, 0, len(self._times) - 2))
        h = self._times[k + 1] - self._times[k]
        s = min(max((time - self._times[k]) / h, 0.0), 1.0)
        (p0, v0), (p1, v1) = self._rows[k], self._rows[k + 1]
        way = p1 - p0
        positions = p0 + s * (h * v0 + s * (3 * way - h * (2 * v0 + v1) + s * (h * (v0 + v1) - 2 * way)))
        velocities = v0 + s * (2 * (3 * way / h - 2 * v0 - v1) + 3 * s * (v0 + v1 - 2 * way / h))
        return positions, velocities
