"""A plan in joints and in time."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from omniservo.geometry.arrays import FloatArray
from omniservo.robots import Arm, FollowedPath, JointPath
from omniservo.servoing import ExponentialLaw, PathLimits, TimeLaw

_TICK = 1e-3
"""[s]"""

_PLACES = 1001
"""at which limits are checked"""


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
    notices: tuple[str, ...] = ()
    """what a person must know of how fast it is"""

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

    @cached_property
    def least_margins(self) -> tuple[FloatArray, FloatArray]:
        """Each joint's least room to its limits (n,) [rad] and the w (n,) where that is."""
        w = np.linspace(0.0, 1.0, _PLACES)
        margins = self.arm.limit_margins(self.joints(w))
        return margins.min(axis=0), w[margins.argmin(axis=0)]

    @property
    def least_singular_value(self) -> tuple[float, float]:
        """The smallest at the joint path's samples, and its w."""
        place = int(self.joints.singular_values.argmin())
        return float(self.joints.singular_values[place]), float(self.joints.w[place])

    def is_own(self, branch: JointPath) -> bool:
        """Return whether a branch begins in the arm's own configuration, full turns aside."""
        return bool(np.abs(np.sin(0.5 * (branch.positions[0] - self.joints.positions[0]))).max() < 1e-6)

    def posture(self, time: float) -> tuple[FloatArray, FloatArray]:
        """Return the joints (n,) [rad] and their speeds [rad/s] at ``time`` [s]."""
        w, speed = self.law(time)
        return self.joints(w), self.joints(w, 1) * speed

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
