"""Where along a path samples are checked, and what a few of them take there."""

from __future__ import annotations

import math
from typing import NamedTuple

from numpy import maximum

from omniservo.geometry.arrays import BoolArray, FloatArray
from omniservo.risk.servo_response import ServoResponse

NEARLY = 2.0
"""times what any of a few samples takes of a constraint anywhere: where it is planned to leave so much more
than at its tightest place, that place is taken to be tighter for every sample"""

FAR = 8.0
"""times what any of a few samples takes of a constraint at a place: what is planned to leave more there is
taken to be kept by every sample"""


class CheckedPlaces(NamedTuple):
    """Places of a path, what every constraint leaves there as planned, and what a few samples take of it."""

    response: ServoResponse
    planned: FloatArray
    """(W, e + 2) of every column of the kernel's result"""
    taken: FloatArray
    """(W, e + 2) the most of it that any of the few takes"""

    @property
    def nearly_tightest(self) -> BoolArray:
        """(W, e + 2) where a constraint may be as tight as anywhere."""
        tightest, taken = self.planned.min(axis=0), self.taken.max(axis=0)
        near: BoolArray = (self.planned <= tightest + NEARLY * taken) & (self.planned < math.inf)
        return near

    @property
    def in_danger(self) -> BoolArray:
        """(W, e + 2) the tightest places of each constraint, and where it leaves little.

        Not only of those that are nearly tightest: there nothing may be taken, as where a path begins.
        """
        danger: BoolArray = self.planned <= maximum(self.planned.min(axis=0), FAR * self.taken)
        return danger & (self.planned < math.inf)
