"""What was sent to the joints and what they were seen to do, over the last moments."""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from omniservo.geometry.arrays import FloatArray
from omniservo.robots import RobotState

SPACING = 5e-3
"""Readings nearer to each other than this are not kept apart [s]."""

_DIGITS = 9
"""of times in seconds"""

_ROWS = 2048
"""Half of them are always kept, at most two in a spacing: 2.5 s and more."""


class Sent(NamedTuple):
    """Velocities that joints were sent."""

    time: float
    """when [s]"""
    velocities: FloatArray
    """(n,) [rad/s]"""


class MotionHistory:
    """Joint positions q as they were read, and where what was sent leads.

    Of the velocities u sent: S = ∫ u, and D = ∫ d, d a velocity that goes after u with the least acceleration
    that a drive may have. Between two readings, and between two times of sending, all are linear; before the
    first reading the robot stands. A reading may be older than what was sent before it came.

    Args:
        state: of the robot at rest.
        acceleration: (n,) the least of the drives [rad/s²].
    """

    def __init__(self, state: RobotState, acceleration: FloatArray) -> None:
        self._acceleration = acceleration
        self.told: Callable[[RobotState | Sent], None] | None = None
        """called with every reading, and with what is sent, as they are taken in"""
        self._velocities, self._slowest = np.zeros((2, len(acceleration)))
        self._seen = _Samples(1, len(acceleration))
        """q"""
        self._sums = _Samples(2, len(acceleration))
        """S and D, up to the newest time of a reading or of sending"""
        self.begin(state)

    def begin(self, state: RobotState) -> None:
        """Drop everything before; the robot stands."""
        time = round(state.time, _DIGITS)
        self._seen.begin(time, state.joint_positions[None])
        self._sums.begin(time, np.zeros((2, len(self._acceleration))))

    @property
    def time(self) -> float:
        """Of the last reading [s]."""
        return self._seen.time

    def measured(self, state: RobotState) -> None:
        """Take a reading in; of a clock set back, begin anew. Times count to the nanosecond, as recorded."""
        if self.told is not None:
            self.told(state)
        time = round(state.time, _DIGITS)
        if time < self.time:
            self.begin(state)
            return
        self._seen.add(time, state.joint_positions[None])
        self._add_up(time)

    def sent(self, velocities: FloatArray, time: float) -> None:
        """Take in what is sent from ``time`` [s] on: velocities (n,) [rad/s]."""
        if self.told is not None:
            self.told(Sent(time, velocities))
        self._add_up(round(time, _DIGITS))
        self._velocities = velocities

    def at(self, times: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Return q, S and D, (…, n) [rad] each, at times (…) [s].

        After the last reading they are those of then; before all that is kept of readings and of what was
        sent, those of its beginning.
        """
        return self.read_at(times), *self.led_at(times)

    def read_at(self, times: FloatArray) -> FloatArray:
        """Return the q of `at` alone."""
        return self._seen.at(self._kept(times))[..., 0, :]

    def led_at(self, times: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return the S and D of `at` alone."""
        sums = self._sums.at(self._kept(times))
        return sums[..., 0, :], sums[..., 1, :]

    def expected(self, times: FloatArray) -> FloatArray:
        """Return the joints (…, n) [rad] at times (…) [s], beyond the last reading as what was sent leads on.

        At t + x, t the time of the last reading: q(t) + S(t) − S(t − x). A reading that is late by x does not
        show yet what was sent in the last x.
        """
        last = self.time
        beyond = np.maximum(times - last, 0.0)
        until, since = self.led_at(np.array(last))[0], self.led_at(last - beyond)[0]
        ahead: FloatArray = self.read_at(times) + until - since
        return ahead

    def _kept(self, times: FloatArray) -> FloatArray:
        """Return the nearest times (…) [s] of which everything is known."""
        kept: FloatArray = np.minimum(np.maximum(times, max(self._seen.begins, self._sums.begins)), self.time)
        return kept

    def _add_up(self, time: float) -> None:
        """Lead S and D on to a time [s] that is not before the newest."""
        elapsed = time - self._sums.time
        if elapsed <= 0.0:
            return
        change = elapsed * self._acceleration
        wanted = self._velocities - self._slowest
        self._slowest = self._slowest + np.minimum(np.maximum(wanted, -change), change)  # clip takes longer
        self._sums.add(time, self._sums.last + elapsed * np.array([self._velocities, self._slowest]))


class _Samples:
    """Values (m, n) over time, the last of them, linear in between.

    Args:
        values: m.
        dof: n.
    """

    def __init__(self, values: int, dof: int) -> None:
        self._times, self._rows, self._count = np.empty(_ROWS), np.empty((_ROWS, values, dof)), 0

    @property
    def time(self) -> float:
        """Of the last values [s]."""
        return float(self._times[self._count - 1])

    @property
    def begins(self) -> float:
        """Of the first values that are kept [s]."""
        return float(self._times[0])

    @property
    def last(self) -> FloatArray:
        """The last values."""
        row: FloatArray = self._rows[self._count - 1]
        return row

    def begin(self, time: float, values: FloatArray) -> None:
        """Drop everything before."""
        self._count, self._times[0], self._rows[0] = 1, time, values

    def add(self, time: float, values: FloatArray) -> None:
        """Add values of a time [s] that is not before the last; nearer than `SPACING` they replace them."""
        last = self._count - 1
        if time > self._times[last] and (last == 0 or time - self._times[last - 1] > SPACING + 1e-9):
            last += 1
        if last == _ROWS:
            last = _ROWS // 2
            self._times[:last], self._rows[:last] = self._times[-last:], self._rows[-last:]
        self._times[last], self._rows[last] = time, values
        self._count = last + 1

    def at(self, times: FloatArray) -> FloatArray:
        """Return them (…, m, n) at times (…) [s]."""
        known, rows = self._times[: self._count], self._rows
        if self._count == 1:
            return np.broadcast_to(rows[0], (*np.shape(times), *rows.shape[1:])).copy()
        if np.ndim(times) == 0:  # by far the most often
            k = min(max(int(known.searchsorted(times)), 1), self._count - 1)
            part = float(times - known[k - 1]) / float(known[k] - known[k - 1])
            part = min(max(part, 0.0), 1.0)
            row: FloatArray = (1.0 - part) * rows[k - 1] + part * rows[k]
            return row
        after = np.minimum(np.maximum(known.searchsorted(times), 1), self._count - 1)
        begin = known[after - 1]
        share = np.minimum(np.maximum((times - begin) / (known[after] - begin), 0.0), 1.0)[..., None, None]
        found: FloatArray = (1.0 - share) * rows[after - 1] + share * rows[after]
        return found
