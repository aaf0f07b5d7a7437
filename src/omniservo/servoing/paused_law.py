"""A time law on a clock that is slowed down to a standstill now and then, and goes on."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from omniservo.errors import InputError
from omniservo.field_docs import with_field_docs
from omniservo.geometry.arrays import FloatArray, finite_number
from omniservo.servoing.time_law import TimeLaw


@with_field_docs
@dataclass(frozen=True)
class Pause:
    """A clock σ that slows down to a standstill and goes on later.

    σ(t) = t before; then σ' = 1 − S(u), u = (t − begin)/slowing, until it stands; from ``resumed`` on, where
    σ' = r, σ' = r + (1 − r) S(v), v = (t − resumed)/rising; S(x) = 3x² − 2x³ on [0, 1].
    """

    begin: float
    """It begins to slow down then [s],"""
    slowing: float
    """and stands so much later [s]."""
    resumed: float = math.inf
    """It goes on then [s], also where it does not stand yet; infinite: it is not known when."""
    rising: float = 1.0
    """So long after it goes right again [s]."""

    def __post_init__(self) -> None:
        finite_number("begin", self.begin)
        finite_number("slowing", self.slowing, above=0.0)
        finite_number("rising", self.rising, above=0.0)
        if not self.resumed >= self.begin:
            raise InputError(f"resumed: {self.resumed:g} s given; legal: from {self.begin:g} s on")

    def clock(self, time: float) -> tuple[float, float, float]:
        """Return σ [s], σ' and σ″ [1/s] at ``time`` [s]."""
        if time <= self.begin:
            return time, 1.0, 0.0
        u = min((min(time, self.resumed) - self.begin) / self.slowing, 1.0)
        clock = self.begin + self.slowing * (u - u**3 + 0.5 * u**4)
        rate = 1.0 - u * u * (3.0 - 2.0 * u)
        if time <= self.resumed:
            return clock, rate, -6.0 * u * (1.0 - u) / self.slowing
        gone, lost = time - self.resumed, 1.0 - rate
        v = min(gone / self.rising, 1.0)
        clock += gone - lost * self.rising * (v - v**3 + 0.5 * v**4)
        return clock, 1.0 - lost * (1.0 - v * v * (3.0 - 2.0 * v)), lost * 6.0 * v * (1.0 - v) / self.rising

    def when(self, clock: float) -> float:
        """Return the time at which σ comes to ``clock`` [s]; infinite where it does not."""
        low = high = clock
        while self.clock(high)[0] < clock:
            if self.resumed == math.inf and high >= self.begin + self.slowing:
                return math.inf
            high += max(1.0, high - clock)
        while high - low > 1e-9 * max(abs(high), 1.0):
            middle = 0.5 * (low + high)
            low, high = (middle, high) if self.clock(middle)[0] < clock else (low, middle)
        return high


@with_field_docs
@dataclass(frozen=True)
class PausedLaw:
    """s(t) = law(σ₁(σ₂(… (t)))), the clocks of pauses: the same places in the same order, later.

    So s and ṡ have no jump where the law has none, and nothing is faster than by the law itself.
    """

    law: TimeLaw
    """without pauses"""
    pauses: tuple[Pause, ...]
    """in the order in which they began"""

    @classmethod
    def of(cls, law: TimeLaw, pause: Pause) -> PausedLaw:
        """Return a law with one more pause, the last to begin."""
        if isinstance(law, PausedLaw):
            return cls(law.law, (*law.pauses, pause))
        return cls(law, (pause,))

    def __call__(self, time: float) -> tuple[float, float]:
        """Return (s, ṡ [1/s]) at ``time`` [s]."""
        clock, rate, _ = self._clock(time)
        s, speed = self.law(clock)
        return s, speed * rate

    def finished(self, time: float) -> bool:
        """Return whether the path counts as run through at ``time`` [s], or is not gone on with."""
        last = self.pauses[-1]
        ends = last.resumed == math.inf and time >= last.begin + last.slowing
        return ends or self.law.finished(self._clock(time)[0])

    def motion(self, times: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Return s, ṡ [1/s] and s̈ [1/s²] at times (m,) [s], finite and after the start."""
        clock, rate, growth = np.array([self._clock(float(t)) for t in times]).reshape(-1, 3).T
        s, speed, change = self.law.motion(clock)
        return s, speed * rate, change * rate**2 + speed * growth

    def _clock(self, time: float) -> tuple[float, float, float]:
        """Return the clock of all pauses [s], its rate and that one's growth [1/s]."""
        rate, growth = 1.0, 0.0
        for pause in reversed(self.pauses):
            time, own, bend = pause.clock(time)
            rate, growth = own * rate, bend * rate * rate + own * growth
        return time, rate, growth
