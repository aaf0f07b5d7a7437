"""Planning within a given time."""

from __future__ import annotations

import math
import time
from typing import Any

from omniservo.geometry.arrays import finite_number


class TimeBudget:
    """So much time from now on; what runs is never interrupted, so it is checked between starts.

    Args:
        seconds: [s], > 0; None: without end.

    Raises:
        InputError: not a number, or not positive.
    """

    def __init__(self, seconds: Any) -> None:
        self.begin = time.perf_counter()
        """when it began, of `time.perf_counter` [s]"""
        self.seconds = math.inf if seconds is None else finite_number("time_budget", seconds, above=0.0)
        """[s]"""

    @property
    def is_bounded(self) -> bool:
        """Whether it ends."""
        return self.seconds < math.inf

    @property
    def is_used_up(self) -> bool:
        """Whether it has ended."""
        return self.is_bounded and time.perf_counter() - self.begin >= self.seconds
