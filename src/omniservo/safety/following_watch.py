"""Whether the joints do what they were commanded."""

from __future__ import annotations

import numpy as np

from omniservo.errors import NotFollowing
from omniservo.geometry.arrays import FloatArray, IntArray
from omniservo.robots import Arm
from omniservo.safety.following_kernel import explained
from omniservo.safety.motion_history import SPACING, MotionHistory
from omniservo.safety.safety_options import SafetyOptions

WINDOWS = np.array([0.25, 0.5, 1.0, 2.0, 4.0, 8.0])
"""in reaction times: how far back motion is compared; slow motion needs the longer ones to be detected, a
reading that jumps the shortest"""

DELAYS = np.linspace(0.0, 1.0, 6)
"""dead times of drives, of the most lag"""

CONSTANTS = np.array([0.0, 0.1, 0.2, 0.4, 0.6, 0.8, 1.0])
"""their time constants, likewise; together they are no more than the most lag"""

STEPS, SPAN = 10, 3
"""What was sent is sampled so many times in the most lag, and back to so many times that."""

GAINS = 10
"""A drive's gain is between one of so many, from the least to the most, and the next but one."""

MEMORY = 2.0
"""A drive within other bounds for so long [s] is another drive."""


class FollowingWatch:
    """Compares how far every joint turned with how far it was sent.

    A drive has a dead time d, a time constant τ with d + τ in [0, L], and a gain g in [g₀, g₁]: over a time T
    it turns by g (S∘w (t) − S∘w (t − T)), S the integral of the velocities sent and w the delayed exponential
    e^(−(s − d)/τ)/τ over s > d that they are averaged with. One that cannot accelerate as fast as they ask
    for turns by something between this and the same of D, which goes after them with the least acceleration
    of a drive. What the joint turned beyond the largest or short of the smallest of them by more than
    ``following_error``, and g times how far S and D differ over a newer part of T, no such drive explains.
    Dead time, time constant and gain belong to a drive: of all cells of a grid over them, one must explain
    all that a joint did in the last `MEMORY`.

    Args:
        arm: for its joints' names.
        options: drive_lag L, least_gain g₀, most_gain g₁, following_error, reaction; S and D are those of
            the `MotionHistory`.
    """

    def __init__(self, arm: Arm, options: SafetyOptions) -> None:
        self._arm, self._options = arm, options
        self._windows = options.reaction * WINDOWS
        back = np.concatenate(([0.0], self._windows))
        lags: FloatArray = np.arange(-1.0, STEPS * SPAN + 2) * (options.drive_lag / STEPS)
        self._sent_back = back[:, None] + lags[1:-1]
        """how long before the last reading motion is sampled: back from each end of each window [s]"""
        self._weights, self._corners = _drives(lags, options.drive_lag)
        gains = np.linspace(options.least_gain, options.most_gain, GAINS)
        self._least, self._most = gains[:-2], gains[2:]
        self._checked = -np.inf
        self._refuted = np.full((GAINS - 2, self._corners.shape[1], arm.dof), -np.inf)
        """when a drive with these bounds last did not explain a joint's motion [s]"""
        self._explained(*np.zeros((2, *self._sent_back.shape, arm.dof)))  # compiled before anything moves

    def check(self, history: MotionHistory) -> None:
        """Compare the motion up to the last reading.

        Raises:
            NotFollowing: a joint moved otherwise than any drive within the bounds would have moved it.
        """
        now = history.time
        if abs(now - self._checked) < SPACING:
            return
        self._checked = now
        q = history.read_at(now - self._sent_back[:, 0])
        moved = (q[0] - q[1:])[:, None, None]  # (windows, 1, 1, n)
        low, high = self._explained(*history.led_at(now - self._sent_back))
        beyond = np.maximum(low - moved, moved - high)
        recent = now - self._refuted <= MEMORY
        wrong = beyond.max(axis=0) > self._options.following_error
        self._refuted[wrong] = now
        left = ~(recent | wrong).all(axis=(0, 1))
        if left.all():
            return
        j = int(np.argmin(left))
        beyond = np.where(recent[..., j], np.inf, beyond[..., j])  # of what explained it until now
        gain, cell = np.unravel_index(int(np.argmin(beyond.max(axis=0))), beyond.shape[1:])
        k = int(np.argmax(beyond[:, gain, cell]))
        raise NotFollowing(
            f"{self._arm.joint_names[j]} turned by {np.rad2deg(moved[k, 0, 0, j]):.2f} deg in "
            f"{self._windows[k]:.3g} s; what was sent asks for {np.rad2deg(low[k, gain, cell, j]):.2f} … "
            f"{np.rad2deg(high[k, gain, cell, j]):.2f} deg, its drive being what it was"
        )

    def _explained(self, sent: FloatArray, slowest: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return the least and the most that drives turn joints by, (windows, gains, cells, n) [rad].

        Args:
            sent: (windows + 1, lags, n) S as it was so long ago [rad].
            slowest: D, likewise.
        """
        averaged = self._weights @ sent, self._weights @ slowest
        fast, slow = (angles[0] - angles[1:] for angles in averaged)  # (windows, drives, n)
        return explained(fast, slow, self._corners, self._least, self._most)


def _drives(lags: FloatArray, most: float) -> tuple[FloatArray, IntArray]:
    """Return how drives weigh what was sent so long ago, and which of them bound the cells of the grid.

    Args:
        lags: evenly spaced, one more before the first and after the last than are weighed [s].
        most: dead time and time constant together [s].

    Returns:
        (drives, lags − 2) weights of a function that is linear between the lags, exact; (4, cells) rows.
    """
    rows: dict[tuple[int, int], int] = {}
    weights: list[FloatArray] = []
    for i, delay in enumerate(most * DELAYS):
        for j, constant in enumerate(most * CONSTANTS):
            since = lags - delay
            # Twice integrated, the exponential is τ e^(−s/τ) after the dead time and τ − s before it; its
            # second difference is the integral of the exponential times the hat function of a lag.
            twice = constant * np.exp(-np.maximum(since, 0.0) / max(constant, 1e-12)) + np.maximum(
                -since, 0.0
            )
            weight = np.diff(twice, 2) / (lags[1] - lags[0])
            weight[-1] += 1.0 - weight.sum()
            rows[i, j] = len(weights)
            weights.append(weight)
    cells = [
        [rows[i, j], rows[i + 1, j], rows[i, j + 1], rows[i + 1, j + 1]]
        for i in range(len(DELAYS) - 1)
        for j in range(len(CONSTANTS) - 1)
        if DELAYS[i] + CONSTANTS[j] < 1.0 - 1e-9
    ]
    return np.array(weights), np.array(cells).T
