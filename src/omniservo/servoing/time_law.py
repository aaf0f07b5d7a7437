"""Time laws w(t): how fast the path parameter runs from 0 to 1."""

import math
from dataclasses import dataclass
from typing import Protocol, Self, TypeVar

import numpy as np

from omniservo.errors import InputError
from omniservo.field_docs import with_field_docs
from omniservo.geometry.arrays import FloatArray, finite_number
from omniservo.servoing.path_limits import PathLimits

EXPONENTIAL_END = 1e-3
"""The exponential law, which never ends, counts as finished when 1 − w falls to this."""

_PLACES = 3201
_RESERVE = 1e-4


class TimeLaw(Protocol):
    """w(t) ∈ [0, 1] with w = 0, ẇ = 0 before t = 0, not decreasing."""

    def __call__(self, time: float) -> tuple[float, float]:
        """Return (w, ẇ [1/s]) at ``time`` [s]."""
        ...

    def finished(self, time: float) -> bool:
        """Return whether the path counts as run through at ``time`` [s]."""
        ...

    def motion(self, times: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Return w, ẇ [1/s] and ẅ [1/s²] at times (m,) [s], finite and after the start."""
        ...


@with_field_docs
@dataclass(frozen=True)
class ExponentialLaw:
    """w(t) = 1 − exp(−λ₁ t), (42): starts with a jump to ẇ = λ₁ and never quite ends."""

    rate: float
    """λ₁ [1/s]"""

    def __post_init__(self) -> None:
        finite_number("rate", self.rate, above=0.0)

    def __call__(self, time: float) -> tuple[float, float]:
        """Return (w, ẇ [1/s]) at ``time`` [s]; (0, 0) before 0.

        Raises:
            InputError: the time is not finite.
        """
        if not math.isfinite(time):
            raise InputError(f"time: {time} given; a finite number of seconds is needed")
        if time < 0.0:
            return 0.0, 0.0
        return -math.expm1(-self.rate * time), self.rate * math.exp(-self.rate * time)

    def finished(self, time: float) -> bool:
        """Return whether 1 − w ≤ EXPONENTIAL_END; w itself goes on towards 1 without a jump."""
        return self.rate * time >= -math.log(EXPONENTIAL_END)

    def motion(self, times: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Return w, ẇ [1/s] and ẅ [1/s²] at times (m,) [s], finite and ≥ 0."""
        left = np.exp(-self.rate * times)
        return -np.expm1(-self.rate * times), self.rate * left, -(self.rate**2) * left


@with_field_docs
@dataclass(frozen=True)
class RestToRestLaw:
    """w(t) = 10u³ − 15u⁴ + 6u⁵, u = t/duration: speed and acceleration are zero at both ends."""

    duration: float
    """[s]"""

    def __post_init__(self) -> None:
        finite_number("duration", self.duration, above=0.0)

    def __call__(self, time: float) -> tuple[float, float]:
        """Return (w, ẇ [1/s]) at ``time`` [s]; (0, 0) before 0 and (1, 0) after the duration.

        Raises:
            InputError: the time is not finite.
        """
        if not math.isfinite(time):
            raise InputError(f"time: {time} given; a finite number of seconds is needed")
        u = min(max(time / self.duration, 0.0), 1.0)
        rest = 1.0 - u
        # Each half from its own end: 1 − w keeps its digits near the goal, and w never exceeds 1.
        w = _rise(u) if u <= 0.5 else 1.0 - _rise(rest)
        return w, 30.0 * u * u * rest * rest / self.duration

    def finished(self, time: float) -> bool:
        """Return whether ``time`` [s] has reached the duration."""
        return time >= self.duration

    def motion(self, times: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Return w, ẇ [1/s] and ẅ [1/s²] at times (m,) [s], finite and ≥ 0."""
        u = np.clip(times / self.duration, 0.0, 1.0)
        rest = 1.0 - u
        w = np.where(u <= 0.5, _rise(u), 1.0 - _rise(rest))
        slope = 30.0 * (u * rest) ** 2 / self.duration
        return w, slope, 60.0 * u * rest * (1.0 - 2.0 * u) / self.duration**2

    @classmethod
    def for_limits(cls, limits: PathLimits, *, least_duration: float = 0.0) -> Self:
        """Return the shortest law that keeps the limits.

        With q̇ = q′ẇ and q̈ = q″ẇ² + q′ẅ, ẇ ∝ 1/T and ẅ ∝ 1/T², the shortest duration T has a closed form at
        every place; limits are checked in 3201 places, evenly in time, and what may lie between gets 0.01%.

        Args:
            limits: along the joint path.
            least_duration: the law is not shorter than this [s].

        Raises:
            InputError: nothing moves and no least_duration is given, or as `PathLimits` says.
        """
        needed = (1.0 + _RESERVE) * limits.excess(*cls(1.0).motion(np.linspace(0.0, 1.0, _PLACES)))
        duration = max(needed, finite_number("least_duration", least_duration, minimum=0.0))
        if duration == 0.0:
            raise InputError("limits.joints: nothing moves; give a least_duration > 0")
        return cls(duration)


_Real = TypeVar("_Real", float, FloatArray)


def _rise(u: _Real) -> _Real:
    return u * u * u * (10.0 + u * (6.0 * u - 15.0))
