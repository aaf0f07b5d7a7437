"""What was sent to the joints and what they were seen to do, over the last moments."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from omniservo.geometry.arrays import FloatArray
from omniservo.robots import RobotState

SPACING = 5e-3
"""Readings nearer to each other than this are not kept apart [s]."""

_DIGITS = 9
"""of times in seconds"""

_ROWS = 1024
"""half of them are always kept: 2.5 s and more"""


class MotionHistory:
    """Joint positions q as they were read, and at the same instants where what was sent leads.

    Of the velocities u sent: S = ∫ u, and D = ∫ d, d a velocity that goes after u with the least acceleration
    that a drive may have. All are linear between two readings; before the first the robot stands.

    Args:
        state: of the robot at rest.
        acceleration: (n,) the least of the drives [rad/s²].
    """

    def __init__(self, state: RobotState, acceleration: FloatArray) -> None:
        self._acceleration = acceleration
        self.told: Callable[[RobotState | FloatArray], None] | None = None
        """called with every reading, and with what is sent, as they are taken in"""
        self._times = np.empty(_ROWS)
        self._rows = np.empty((_ROWS, 3, len(acceleration)))
        self._velocities, self._slowest = np.zeros((2, len(acceleration)))
        self.begin(state)

    def begin(self, state: RobotState) -> None:
        """Drop everything before; the robot stands."""
        self._count = 1
        self._times[0] = round(state.time, _DIGITS)
        self._rows[0] = state.joint_positions, 0.0 * self._velocities, 0.0 * self._velocities

    @property
    def time(self) -> float:
        """Of the last reading [s]."""
        return float(self._times[self._count - 1])

    def measured(self, state: RobotState) -> None:
        """Take a reading in; of a clock set back, begin anew. Times count to the nanosecond, as recorded."""
        if self.told is not None:
            self.told(state)
        last, time = self._count - 1, round(state.time, _DIGITS)
        elapsed = time - self._times[last]
        if elapsed < 0.0:
            self.begin(state)
            return
        if elapsed == 0.0:
            self._rows[last, 0] = state.joint_positions
            return
        change = elapsed * self._acceleration
        self._slowest = self._slowest + np.clip(self._velocities - self._slowest, -change, change)
        sent = self._rows[last, 1] + elapsed * self._velocities
        slowest = self._rows[last, 2] + elapsed * self._slowest
        if last == 0 or time - self._times[last - 1] > SPACING + 1e-9:
            last += 1
        if last == _ROWS:
            last = self._forget_old()
        self._times[last] = time
        self._rows[last] = state.joint_positions, sent, slowest
        self._count = last + 1

    def sent(self, velocities: FloatArray) -> None:
        """Take in what is sent from the last reading on: velocities (n,) [rad/s]."""
        self._velocities = velocities
        if self.told is not None:
            self.told(velocities)

    def at(self, times: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Return q, S and D, (…, n) [rad] each, at times (…) [s]; after the last reading, those of then."""
        known = self._times[: self._count]
        after = np.searchsorted(known, times).clip(1, max(self._count - 1, 1))
        before = after - 1
        if self._count == 1:
            after = before
        gap = known[after] - known[before]
        share = np.clip((times - known[before]) / np.where(gap > 0.0, gap, 1.0), 0.0, 1.0)[..., None, None]
        rows = (1.0 - share) * self._rows[before] + share * self._rows[after]
        return rows[..., 0, :], rows[..., 1, :], rows[..., 2, :]

    def expected(self, times: FloatArray) -> FloatArray:
        """Return the joints (…, n) [rad] at times (…) [s], beyond the last reading as what was sent leads on.

        At t + x, t the time of the last reading: q(t) + S(t) − S(t − x). A reading that is late by x does not
        show yet what was sent in the last x.
        """
        last = self.time
        q = self.at(times)[0]
        beyond = np.maximum(times - last, 0.0)
        since = self.at(last - beyond)[1]
        ahead: FloatArray = q + self._rows[self._count - 1, 1] - since
        return ahead

    def _forget_old(self) -> int:
        """Make room; return the row to write."""
        kept = _ROWS // 2
        self._times[:kept], self._rows[:kept] = self._times[-kept:], self._rows[-kept:]
        return kept
