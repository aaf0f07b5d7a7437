"""What is left of a time law when another path is entered on the way, slowed down where that requires it."""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from typing import NamedTuple, Self

import numpy as np

from omniservo.errors import InputError
from omniservo.field_docs import with_field_docs
from omniservo.geometry.arrays import FloatArray, finite_number
from omniservo.servoing.path_limits import LimitsAt, PathLimits
from omniservo.servoing.time_law import TimeLaw

RAMPS = (0.1, 0.3, 0.9)
"""[s] in which the clock may be slowed down: the one that asks least of the joints is taken."""

LEAST_PACE = 0.1
"""A path on which even so slow a clock would not do is too sharp for the speed at which it is entered."""

_PLACES = 401
_IN_RAMP = 33  # beside those, in each ramp: a long law's places are farther apart than a ramp takes
_SLOWER = 0.85  # at least by this factor in every round
_MET = 1.002  # what a law that just met its limits may exceed them by here, where places lie otherwise


class _Motion(NamedTuple):
    """Along an even clock."""

    clock: FloatArray
    """(m,) τ [s]"""
    s: FloatArray
    """(m,)"""
    speed: FloatArray
    """(m,) ds/dτ [1/s]"""
    change: FloatArray
    """(m,) d²s/dτ² [1/s²]"""


@with_field_docs
@dataclass(frozen=True)
class RestOfLaw:
    """s(t) = (w(τ(t)) − w₀)/(1 − w₀) from t = begin on, w₀ = w(begin): starts at 0 with the present speed.

    τ is a clock that goes right at first, τ(begin) = begin and τ' = 1, and within ``ramp`` has slowed down to
    τ' = pace: τ' = 1 − (1 − pace)(3u² − 2u³), u = (t − begin)/ramp. So s and ṡ have no jump, and s̈ has
    none where w's has none.
    """

    law: TimeLaw
    """w(t), which was followed until now"""
    begin: float
    """[s]"""
    pace: float = 1.0
    """of the slowed clock, in (0, 1]; 1: the law is carried on"""
    ramp: float = RAMPS[0]
    """[s]"""
    _done: float = field(init=False, repr=False, compare=False, default=0.0)

    def __post_init__(self) -> None:
        finite_number("begin", self.begin)
        finite_number("pace", self.pace, above=0.0, maximum=1.0)
        finite_number("ramp", self.ramp, above=0.0)
        done, _ = self.law(self.begin)
        if not done < 1.0:
            raise InputError(f"begin: {self.begin:g} s given; the law has reached w = 1 by then")
        object.__setattr__(self, "_done", done)

    def __call__(self, time: float) -> tuple[float, float]:
        """Return (s, ṡ [1/s]) at ``time`` [s]; (0, 0) before the beginning.

        Raises:
            InputError: the time is not finite.
        """
        if math.isfinite(time) and time < self.begin:
            return 0.0, 0.0
        clock, rate = self._clock(time)
        w, speed = self.law(clock)
        left = 1.0 - self._done
        return (w - self._done) / left, speed * rate / left

    def finished(self, time: float) -> bool:
        """Return whether the path counts as run through at ``time`` [s]."""
        return time > self.begin and self.law.finished(self._clock(time)[0])

    def motion(self, times: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Return s, ṡ [1/s] and s̈ [1/s²] at times (m,) [s], finite and from the beginning on."""
        lost, gone = 1.0 - self.pace, times - self.begin
        u = np.minimum(gone / self.ramp, 1.0)
        late = lost * (self.ramp * u**3 * (1.0 - 0.5 * u) + np.maximum(gone - self.ramp, 0.0))
        rate = 1.0 - lost * u**2 * (3.0 - 2.0 * u)
        w, speed, growth = self.law.motion(times - late)
        bend = growth * rate**2 - speed * lost * 6.0 * u * (1.0 - u) / self.ramp
        left = 1.0 - self._done
        return (w - self._done) / left, speed * rate / left, bend / left

    @classmethod
    def within(cls, law: TimeLaw, begin: float, limits: PathLimits | None) -> Self | None:
        """Return the rest of a law, slowed down as far as limits need it; None: no clock is slow enough.

        Limits are checked in 401 places, and in 33 of each ramp; one that the law just met may be exceeded by
        0.2%.

        Args:
            law: what is followed until then.
            begin: [s] when the new path is entered.
            limits: along the new path, over s; None: the law is carried on as it is.

        Raises:
            InputError: the law has reached w = 1 by then, or as `PathLimits` says.
        """
        if isinstance(law, RestOfLaw) and law.pace == 1.0:
            law = law.law  # of the rest of a rest: the same numbers, without a law around every law before
        found = cls(law, begin)
        if limits is None:
            return found
        motion = found._motion()
        kept = limits.at(motion.s)
        excess = found._excess(kept, motion)
        while excess > _MET:
            pace = found.pace * min(0.99 / excess, _SLOWER)
            if pace < LEAST_PACE:
                return None
            tried = [cls(law, begin, pace, ramp) for ramp in RAMPS]
            needed = [rest._excess(kept, motion) for rest in tried]
            excess, found = min(needed), tried[int(np.argmin(needed))]
        return found

    def keeps(self, limits: PathLimits) -> bool:
        """Return whether the law keeps limits along its path; checked as by `within`."""
        motion = self._motion()
        return self._excess(limits.at(motion.s), motion) <= _MET

    def _excess(self, limits: LimitsAt, motion: _Motion) -> float:
        """Return by how much time had to be stretched to keep limits; ``motion`` is that of an even clock."""
        if self.pace == 1.0:
            return limits.excess(motion.speed, motion.change)
        rate, growth = _slowed(motion.clock - self.begin, self.pace, self.ramp)
        speed, change = motion.speed * rate, motion.change * rate**2 + motion.speed * growth
        return limits.excess(speed, change)

    def _clock(self, time: float) -> tuple[float, float]:
        """Return τ [s] and τ' at ``time`` ≥ begin [s]."""
        lost = 1.0 - self.pace
        u = min((time - self.begin) / self.ramp, 1.0)
        late = lost * (self.ramp * u**3 * (1.0 - 0.5 * u) + max(time - self.begin - self.ramp, 0.0))
        return time - late, 1.0 - lost * u * u * (3.0 - 2.0 * u)

    def _motion(self) -> _Motion:
        """Return the motion until the law is finished."""
        span = 1.0
        while not self.law.finished(self.begin + span):
            span *= 2.0
        low = 0.0
        while span - low > 1e-4 * span:
            middle = 0.5 * (low + span)
            low, span = (low, middle) if self.law.finished(self.begin + middle) else (middle, span)
        ramps = np.outer(RAMPS, np.linspace(0.0, 1.0, _IN_RAMP)).ravel()
        gone = np.union1d(np.linspace(0.0, span, _PLACES), ramps[ramps < span])
        clock = self.begin + gone
        w, speed, growth = self.law.motion(clock)
        left = 1.0 - self._done
        return _Motion(clock, np.clip((w - self._done) / left, 0.0, 1.0), speed / left, growth / left)


def _slowed(elapsed: FloatArray, pace: float, ramp: float) -> tuple[FloatArray, FloatArray]:
    """Return τ' and its derivative [1/s] where the slowed clock has gone on by ``elapsed`` (m,) [s]."""
    u = np.linspace(0.0, 1.0, _PLACES)
    gone = ramp * (u - (1.0 - pace) * u**3 * (1.0 - 0.5 * u))
    at = np.interp(elapsed, gone, u)
    rate: FloatArray = 1.0 - (1.0 - pace) * at**2 * (3.0 - 2.0 * at)
    growth: FloatArray = -(1.0 - pace) * 6.0 * at * (1.0 - at) / ramp
    return rate, growth
