"""A plan in joints and in time."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from omniservo.geometry.arrays import FloatArray
from omniservo.robots import Arm, FollowedPath, JointPath
from omniservo.servoing import ExponentialLaw, PathLimits, TimeLaw

_TICK = 1e-3
"""[s]"""


@dataclass(frozen=True, eq=False)
class PlannedMotion:
    """The joints that the arm is to go through, how fast, and what else it could have done."""

    arm: Arm
    joints: JointPath
    """the branch on which the arm stands"""
    law: TimeLaw
    limits: PathLimits
    """what the law may use of the arm's speeds and accelerations; and the image speed, where it is bounded"""
    time_optimal_seconds: float
    """of the fastest law within ``limits``"""
    others: FollowedPath
    """every branch in which the arm could begin, its own among them"""

    @property
    def seconds(self) -> float:
        """When the law is finished [s]."""
        low, high = 0.0, 1.0
        while not self.law.finished(high):
            low, high = high, 2.0 * high
        while high - low > 1e-6 * high:
            middle = 0.5 * (low + high)
            low, high = (low, middle) if self.law.finished(middle) else (middle, high)
        return high

    def times(self) -> FloatArray:
        """Return the motion's milliseconds, (m,) [s]."""
        return np.arange(0.0, self.seconds + _TICK, _TICK)

    def pace(self, times: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return w and ẇ [1/s] at ``times`` (m,) [s]."""
        values = np.array([self.law(float(t)) for t in times]).reshape(-1, 2)
        return values[:, 0], values[:, 1]

    def speed_shares(self, times: FloatArray) -> FloatArray:
        """Return |q̇| over the arm's speeds, (m, n), at ``times`` (m,) [s]."""
        w, speed = self.pace(times)
        shares: FloatArray = np.abs(self.joints(w, 1) * speed[:, None]) / self.arm.joint_speed
        return shares

    def acceleration_shares(self, times: FloatArray) -> FloatArray | None:
        """Return |q̈| over the arm's accelerations, (m, n), at ``times`` [s].

        None: the law begins with a jump. ẅ is a difference of ẇ over 0.2 ms.
        """
        if isinstance(self.law, ExponentialLaw):
            return None
        step = 0.1 * _TICK
        w, speed = self.pace(times)
        change = (self.pace(times + step)[1] - self.pace(times - step)[1]) / (2.0 * step)
        bend = self.joints(w, 2) * speed[:, None] ** 2 + self.joints(w, 1) * change[:, None]
        shares: FloatArray = np.abs(bend) / self.arm.joint_acceleration
        return shares
