"""A part of the way: a path, and how fast it is gone."""

from __future__ import annotations

from dataclasses import dataclass, replace

from omniservo.field_docs import with_field_docs
from omniservo.planning import CameraPath
from omniservo.servoing import Pause, PausedLaw, TimeLaw


@with_field_docs
@dataclass(frozen=True, eq=False)
class Leg:
    """A path that is followed from some time on, to the goal or until the next leg is entered."""

    path: CameraPath
    """initial_T_camera of s in [0, 1]"""
    law: TimeLaw
    """s of the time since the servo's start"""
    time: float = 0.0
    """when it is entered, since the servo's start [s]"""
    begin: float = 0.0
    """w where it begins: w(s) = begin + (1 − begin)s goes on from leg to leg and ends with 1"""

    def w(self, time: float) -> tuple[float, float]:
        """Return w and ẇ [1/s] at ``time`` [s]."""
        s, speed = self.law(time)
        return self.begin + (1.0 - self.begin) * s, (1.0 - self.begin) * speed

    def paused(self, pause: Pause) -> Leg:
        """Return the same way with a pause; it is entered later where the pause begins before it is."""
        return replace(self, law=PausedLaw.of(self.law, pause), time=pause.when(self.time))
