"""Whether the joints do what they were told."""

from __future__ import annotations

import numpy as np

from omniservo.errors import NotFollowing
from omniservo.geometry.arrays import FloatArray
from omniservo.robots import Arm
from omniservo.safety.motion_history import SPACING, MotionHistory
from omniservo.safety.safety_options import SafetyOptions

WINDOWS = np.array([0.25, 0.5, 1.0, 2.0, 4.0, 8.0])
"""in reaction times: how far back motion is compared; slow motion needs the longer ones to be told, a reading
that jumps the shortest"""

LAGS = 11
"""of the drive, from none to the most"""

LAG_RANGES = ((0, 4), (2, 6), (4, 8), (6, 10), (0, 10))
"""first and last of `LAGS`: within one of these a drive's lag stays,"""

GAINS = 10
"""and its gain between one of so many, from the least to the most, and the next but one."""

MEMORY = 2.0
"""A drive within other bounds for so long [s] is another drive."""


class FollowingWatch:
    """Compares how far every joint turned with how far it was sent.

    Over a time T a drive of lag l in [0, L] and gain g in [g₀, g₁] turns by g (S(t − l) − S(t − T − l)), S
    the integral of the velocities sent; one that cannot accelerate as fast as they ask for by something
    between this and the same of D, which goes after them with the least acceleration of a drive. A lag
    spread over a range gives an average of these. What the joint turned beyond the largest or short of the
    smallest of them by more than ``following_error``, and by how far S and D differ over T, no such drive
    explains. Gain and lag belong to a drive: of all combinations of a part of the gains and a part of the
    lags, one must explain all that a joint did in the last `MEMORY`.

    Args:
        arm: for its joints' names.
        options: drive_lag L, least_gain g₀, most_gain g₁, following_error, reaction; S and D are those of
            the `MotionHistory`.
    """

    def __init__(self, arm: Arm, options: SafetyOptions) -> None:
        self._arm, self._options = arm, options
        self._windows = options.reaction * WINDOWS
        self._back = np.concatenate(([0.0], self._windows))
        self._sent_back = self._back[:, None] + np.linspace(0.0, options.drive_lag, LAGS)
        gains = np.linspace(options.least_gain, options.most_gain, GAINS)
        self._gains = np.stack((gains[:-2], gains[2:]))[..., None, None, None]
        self._checked = -np.inf
        self._refuted = np.full((GAINS - 2, len(LAG_RANGES), arm.dof), -np.inf)
        """when a drive with these bounds last did not explain a joint's motion [s]"""

    def check(self, history: MotionHistory) -> None:
        """Compare the motion up to the last reading.

        Raises:
            NotFollowing: a joint moved otherwise than any drive within the bounds would have moved it.
        """
        now = history.time
        if abs(now - self._checked) < SPACING:
            return
        self._checked = now
        turned = history.at(now - self._back)[0]
        moved = turned[0] - turned[1:]
        low, high = self._explained(history)
        beyond = np.maximum(low - moved, moved - high)  # (gains, lags, windows, n)
        recent = now - self._refuted <= MEMORY
        wrong = beyond.max(axis=2) > self._options.following_error
        self._refuted[wrong] = now
        left = ~(recent | wrong).all(axis=(0, 1))
        if left.all():
            return
        j = int(np.argmin(left))
        beyond = np.where(recent[..., j, None], np.inf, beyond[..., j])  # of what explained it until now
        best = np.unravel_index(int(np.argmin(beyond.max(axis=2))), beyond.shape[:2])
        k = int(np.argmax(beyond[best]))
        raise NotFollowing(
            f"{self._arm.joint_names[j]} turned by {np.rad2deg(moved[k, j]):.2f} deg in "
            f"{self._windows[k]:.3g} s; what was sent asks for {np.rad2deg(low[best][k, j]):.2f} … "
            f"{np.rad2deg(high[best][k, j]):.2f} deg, its drive being what it was"
        )

    def _explained(self, history: MotionHistory) -> tuple[FloatArray, FloatArray]:
        """Return the least and the most that drives turn their joints by, (gains, lags, windows, n) [rad]."""
        fast, slow = (sent[0] - sent[1:] for sent in history.at(history.time - self._sent_back)[1:])
        apart, least, most = np.abs(fast - slow), np.minimum(fast, slow), np.maximum(fast, slow)
        parts = [slice(first, last + 1) for first, last in LAG_RANGES]
        apart = np.stack([apart[:, part].max(axis=1) for part in parts])
        low = np.stack([least[:, part].min(axis=1) for part in parts])
        high = np.stack([most[:, part].max(axis=1) for part in parts])
        return (self._gains * low).min(axis=0) - apart, (self._gains * high).max(axis=0) + apart
