"""Time laws w(t): how fast the path parameter runs from 0 to 1."""

import math
from dataclasses import dataclass
from typing import Protocol, Self

import numpy as np
import numpy.typing as npt

from omniservo.errors import InputError
from omniservo.geometry.arrays import FloatArray, finite_array, finite_number

EXPONENTIAL_END = 1e-3
"""The exponential law, which never ends, counts as finished when 1 − w falls to this."""


class TimeLaw(Protocol):
    """w(t) ∈ [0, 1] with w = 0, ẇ = 0 before t = 0, not decreasing."""

    def __call__(self, time: float) -> tuple[float, float]:
        """Return (w, ẇ [1/s]) at ``time`` [s]."""
        ...

    def finished(self, time: float) -> bool:
        """Return whether the path counts as run through at ``time`` [s]."""
        ...


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

    @classmethod
    def for_limits(
        cls,
        w: npt.ArrayLike,
        rates: npt.ArrayLike,
        second_rates: npt.ArrayLike,
        speed_limits: npt.ArrayLike,
        acceleration_limits: npt.ArrayLike,
        *,
        least_duration: float = 0.0,
    ) -> Self:
        """Return the shortest law that keeps speed and acceleration limits at the sampled places.

        With q̇ = q′ẇ and q̈ = q″ẇ² + q′ẅ, ẇ ∝ 1/T and ẅ ∝ 1/T², the shortest duration T has a closed form.
        Between the samples nothing is promised: sample densely (a hundred places) where q bends.

        Args:
            w: (m,) path parameters in [0, 1].
            rates: (m, k) dq/dw there; q may be joint angles, a position, anything with limits.
            second_rates: (m, k) d²q/dw².
            speed_limits: (k,) greatest |q̇|, > 0.
            acceleration_limits: (k,) greatest |q̈|, > 0.
            least_duration: the law is not shorter than this [s].

        Raises:
            InputError: wrong shapes, w outside [0, 1], limits not positive, or nothing moves and no
                least_duration is given.
        """
        places = finite_array("w", w, (None,))
        first = finite_array("rates", rates, (len(places), None))
        second = finite_array("second_rates", second_rates, first.shape)
        speeds = finite_array("speed_limits", speed_limits, first.shape[1:])
        accelerations = finite_array("acceleration_limits", acceleration_limits, first.shape[1:])
        if (places < 0.0).any() or (places > 1.0).any():
            raise InputError(f"w: {places.min():g} … {places.max():g} given; legal: within [0, 1]")
        if (speeds <= 0.0).any() or (accelerations <= 0.0).any():
            raise InputError("speed_limits, acceleration_limits: every limit must be > 0")
        u = _time_at(places)[:, None]
        slope = 30.0 * u**2 * (1.0 - u) ** 2
        bend = 60.0 * u * (1.0 - u) * (1.0 - 2.0 * u)
        by_speed = np.abs(first * slope) / speeds
        by_acceleration = np.sqrt(np.abs(second * slope**2 + first * bend) / accelerations)
        needed = max(by_speed.max(initial=0.0), by_acceleration.max(initial=0.0))
        duration = max(float(needed), finite_number("least_duration", least_duration, minimum=0.0))
        if duration == 0.0:
            raise InputError("rates: nothing moves; give a least_duration > 0")
        return cls(duration)


def _rise(u: float) -> float:
    return u * u * u * (10.0 + u * (6.0 * u - 15.0))


def _time_at(w: FloatArray) -> FloatArray:
    """Return u ∈ [0, 1] with 10u³ − 15u⁴ + 6u⁵ = w by bisection, (m,)."""
    low, high = np.zeros_like(w), np.ones_like(w)
    for _ in range(60):
        middle = 0.5 * (low + high)
        below = middle**3 * (10.0 + middle * (6.0 * middle - 15.0)) < w
        low, high = np.where(below, middle, low), np.where(below, high, middle)
    return 0.5 * (low + high)
