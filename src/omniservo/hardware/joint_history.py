"""The joints of the last two seconds, at any instant of them."""

from __future__ import annotations

from threading import Lock

import numpy as np
import numpy.typing as npt

from omniservo.errors import ClockFault, InputError, NotFinite
from omniservo.geometry.arrays import FloatArray, finite_array, finite_number
from omniservo.robots import RobotState

KEPT = 2.0
"""[s]"""

AHEAD = 0.1
"""Beyond the newest reading joints go on with its velocities for so long [s], then stand."""

_ROWS = 4096
"""at most: 2 s of 1 kHz, twice"""


class JointHistory:
    """Joint readings by their time stamps, between which joints go by cubics that have both ends' velocities.

    What adds readings and what looks them up may be two threads.

    Args:
        dof: number of joints n.
        kept: how long readings are kept [s].

    Raises:
        InputError: ``kept`` is not positive.
    """

    def __init__(self, dof: int, kept: float = KEPT) -> None:
        self._dof, self._kept = dof, finite_number("kept", kept, above=0.0)
        self._times = np.empty(_ROWS)
        self._rows = np.empty((_ROWS, 2, dof))
        self._begin = self._end = 0
        self._lock = Lock()

    def __len__(self) -> int:
        return self._end - self._begin

    def add(self, state: RobotState) -> None:
        """Take a reading in; one of the newest reading's time or before is passed over.

        Raises:
            NotFinite: a number is not finite.
            InputError: another number of joints.
            ClockFault: the reading is older than all that is kept.
        """
        row = np.array([state.joint_positions, state.joint_velocities], dtype=np.float64)
        if row.shape != (2, self._dof):
            raise InputError(f"state: {row.shape[1:]} joints given; {self._dof} are needed")
        if not (np.isfinite(row).all() and np.isfinite(state.time)):
            raise NotFinite(f"a joint reading of {state.time} s: {row.tolist()}")
        with self._lock:
            if len(self) and state.time <= self._times[self._end - 1]:
                if state.time < self._times[self._begin] - self._kept:
                    raise ClockFault(
                        f"a joint reading of {state.time:.3f} s after one of "
                        f"{self._times[self._end - 1]:.3f} s"
                    )
                return
            if self._end == _ROWS:
                self._make_room()
            self._times[self._end], self._rows[self._end] = state.time, row
            self._end += 1
            while self._times[self._begin] < state.time - self._kept:
                self._begin += 1

    def at(self, times: npt.ArrayLike) -> FloatArray:
        """Return the joints (…, n) [rad] at times (…) [s].

        Before the oldest reading they stood; after the newest they go on with its velocities for `AHEAD`.

        Raises:
            InputError: there is no reading yet, or a time is not a finite number.
        """
        asked = finite_array("times", np.atleast_1d(times), (-1,)).reshape(np.shape(times))
        with self._lock:
            if not len(self):
                raise InputError("times: asked for before the first joint reading")
            known, rows = self._times[self._begin : self._end], self._rows[self._begin : self._end]
            after = np.searchsorted(known, asked).clip(min(1, len(known) - 1), len(known) - 1)
            before = np.maximum(after - 1, 0)
            newest, last = known[-1], rows[-1, 1].copy()
            begin, end, a, b = known[before], known[after], rows[before], rows[after]
        h: FloatArray = np.where(end > begin, end - begin, 1.0)[..., None]
        s: FloatArray = (np.clip(asked, begin, end) - begin)[..., None] / h
        joints = (
            (1 + 2 * s) * (1 - s) ** 2 * a[..., 0, :]
            + s * (1 - s) ** 2 * h * a[..., 1, :]
            + s**2 * (3 - 2 * s) * b[..., 0, :]
            + s**2 * (s - 1) * h * b[..., 1, :]
        )
        ahead: FloatArray = joints + np.clip(asked - newest, 0.0, AHEAD)[..., None] * last
        return ahead

    def _make_room(self) -> None:
        """Drop the older half at least, and begin the arrays anew."""
        self._begin = max(self._begin, self._end - _ROWS // 2)
        left = slice(self._begin, self._end)
        count = len(self)
        self._times[:count], self._rows[:count] = self._times[left].copy(), self._rows[left].copy()
        self._begin, self._end = 0, count
