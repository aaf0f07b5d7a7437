"""Whether the joints do what they were told."""

from __future__ import annotations

import numpy as np

from omniservo.errors import NotFollowing
from omniservo.robots import Arm
from omniservo.safety.motion_history import SPACING, MotionHistory
from omniservo.safety.safety_options import SafetyOptions

WINDOWS = np.array([0.25, 1.0, 2.0, 4.0, 8.0])
"""in reaction times: how far back motion is compared; slow motion needs the longer ones to be told, a reading
that jumps the shortest"""

LAGS = 11
"""of the drive, from none to the most"""


class FollowingWatch:
    """Compares how far every joint turned with how far it was sent.

    Over a time T a drive of lag l in [0, L] and gain g in [g₀, g₁] turns by g (S(t − l) − S(t − T − l)), S
    the integral of the velocities sent; one that cannot accelerate as fast as they ask for by something
    between this and the same of D, which goes after them with the least acceleration of a drive. A lag
    spread over [0, L] gives an average of these. What the joint turned beyond the largest or short of the
    smallest of them by more than ``following_error``, and by how far S and D differ over T, no such drive
    explains.

    Args:
        arm: for its joints' names.
        options: drive_lag L, least_gain g₀, most_gain g₁, following_error, reaction; S and D are those of
            the `MotionHistory`.
    """

    def __init__(self, arm: Arm, options: SafetyOptions) -> None:
        self._arm, self._options = arm, options
        self._windows = options.reaction * WINDOWS
        lags = np.linspace(0.0, options.drive_lag, LAGS)
        self._back = np.concatenate(([0.0], self._windows))
        self._sent_back = self._back[:, None] + lags
        self._checked = -np.inf

    def check(self, history: MotionHistory) -> None:
        """Compare the motion up to the last reading.

        Raises:
            NotFollowing: a joint moved otherwise than any drive within the bounds would have moved it.
        """
        options, now = self._options, history.time
        if abs(now - self._checked) < SPACING:
            return
        self._checked = now
        turned = history.at(now - self._back)[0]
        moved = turned[0] - turned[1:]
        fast, slow = (sent[0] - sent[1:] for sent in history.at(now - self._sent_back)[1:])
        told = np.concatenate((fast, slow), axis=1)  # (windows, lags of S and of D, n)
        bounds = np.stack((options.least_gain * told, options.most_gain * told))
        apart = np.abs(fast - slow).max(axis=1)
        low, high = bounds.min(axis=(0, 2)) - apart, bounds.max(axis=(0, 2)) + apart
        beyond = np.maximum(low - moved, moved - high)
        if beyond.max() <= options.following_error:
            return
        k, j = np.unravel_index(int(np.argmax(beyond)), beyond.shape)
        raise NotFollowing(
            f"{self._arm.joint_names[j]} turned by {np.rad2deg(moved[k, j]):.2f} deg in "
            f"{self._windows[k]:.1f} s; what was sent asks for {np.rad2deg(low[k, j]):.2f} … "
            f"{np.rad2deg(high[k, j]):.2f} deg"
        )
