"""From an image's exposure to the action of its twist, measured for every image."""

from __future__ import annotations

from collections import deque

import numpy as np

_COUNTED = 9
"""images over which the time between them, and that of computing, is known"""


class MeasuredDelays:
    """What is known of the delay of an image's twist before the twist is computed.

    Args:
        command_lag: from a command until the arm acts on it [s].
        longest: what lies between two images that are farther apart than this [s] is a gap, no period.
    """

    def __init__(self, command_lag: float, longest: float) -> None:
        self._lag, self._longest = command_lag, longest
        self._computing: deque[float] = deque(maxlen=_COUNTED)
        self._periods: deque[float] = deque(maxlen=_COUNTED)
        self._exposed = self._now = np.nan
        self.period = np.nan
        """between two images, in the median [s]; NaN before there were two"""

    @property
    def first(self) -> float:
        """From the newest image's exposure until its twist begins to act [s]."""
        computing = float(np.median(self._computing)) if self._computing else 0.0
        return max(self._now - self._exposed, 0.0) + computing + self._lag

    @property
    def mean(self) -> float:
        """Until the middle of the time in which it acts: till the next image's does [s]."""
        return self.first + (0.5 * self.period if self._periods else 0.0)

    def seen(self, exposed: float, now: float) -> None:
        """Take in an image, exposed at ``exposed`` [s], whose points were found ``now`` [s]."""
        if exposed - self._exposed <= self._longest:
            self._periods.append(exposed - self._exposed)
            self.period = float(np.median(self._periods))
        self._exposed, self._now = exposed, now

    def commanded(self, now: float) -> None:
        """Take in when its twist was passed on [s]."""
        self._computing.append(now - self._now)
