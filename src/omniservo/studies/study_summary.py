"""What the rows of a study say of each method."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

_Z = 1.959963984540054
"""standard deviations that a two-sided interval of 95% reaches to"""
_TAIL = 0.025
"""on each side of such an interval"""


@dataclass(frozen=True)
class Rate:
    """A share of rows, with its confidence interval."""

    count: int
    of: int

    @property
    def share(self) -> float:
        """Count / of; NaN of nothing."""
        return self.count / self.of if self.of else math.nan

    @property
    def interval(self) -> tuple[float, float]:
        """Wilson's interval (1927) of 95%; [0, 1] of nothing."""
        if not self.of:
            return 0.0, 1.0
        n, p = self.of, self.share
        middle = (p + _Z**2 / (2 * n)) / (1 + _Z**2 / n)
        half = _Z / (1 + _Z**2 / n) * math.sqrt(p * (1 - p) / n + _Z**2 / (4 * n**2))
        return max(0.0, middle - half), min(1.0, middle + half)

    def to_dict(self) -> dict[str, object]:
        """Return count, of, share and interval."""
        return {"count": self.count, "of": self.of, "share": self.share, "interval_95": list(self.interval)}


@dataclass(frozen=True)
class Median:
    """The median of some numbers, with its confidence interval."""

    value: float
    """NaN of none"""
    interval: tuple[float, float]
    """Of 95%, whatever the distribution: two of the numbers, by the binomial law of how many lie below the
    median (Thompson 1936); NaN of fewer than six."""

    @classmethod
    def of(cls, numbers: Sequence[float]) -> Median:
        """Return that of numbers in any order."""
        count = len(numbers)
        if not count:
            return cls(math.nan, (math.nan, math.nan))
        from scipy.stats import binom

        found = np.sort(numbers)
        below = int(binom.ppf(_TAIL, count, 0.5))
        ends = (math.nan, math.nan) if below < 1 else (float(found[below - 1]), float(found[count - below]))
        return cls(float(np.median(found)), ends)


RATES = ("success", "collision", "joint_limit", "feature_lost", "diverged")
MEDIANS = ("translation_m", "rotation_rad", "path_length_m", "seconds")


@dataclass(frozen=True)
class ArmRates:
    """One method over all rows that count with one arm, or without any."""

    success: Rate
    collision: Rate
    """without an arm: of the rows with an obstacle"""
    joint_limit: Rate
    """of no row without an arm"""

    def to_dict(self) -> dict[str, object]:
        """Return everything as JSON has it."""
        return {name: rate.to_dict() for name, rate in vars(self).items()}


@dataclass(frozen=True)
class MethodSummary:
    """One method over all rows that count."""

    method: str
    success: Rate
    collision: Rate
    """of the rows with an obstacle or an arm"""
    joint_limit: Rate
    """of the rows with an arm"""
    feature_lost: Rate
    diverged: Rate
    statuses: dict[str, int]
    """how its runs ended"""
    stops: dict[str, int]
    """by which names those were stopped that are `stopped`"""
    translation_m: Median
    """final error of the successful runs"""
    rotation_rad: Median
    """likewise"""
    path_length_m: Median
    """of the successful runs"""
    seconds: Median
    """likewise, of the run"""
    arms: dict[str, ArmRates]
    """by the arms that rows have, "none" among them"""

    def to_dict(self) -> dict[str, object]:
        """Return everything as JSON has it."""
        rates = {name: getattr(self, name).to_dict() for name in RATES}
        medians = {name: getattr(self, name).value for name in MEDIANS}
        intervals = {name: list(getattr(self, name).interval) for name in MEDIANS}
        arms = {name: of_arm.to_dict() for name, of_arm in self.arms.items()}
        return {**vars(self), **rates, **medians, "median_intervals_95": intervals, "arms": arms}


def percent(rate: Rate) -> str:
    """Return a rate for a table."""
    return f"{100 * rate.share:.1f}%" if rate.of else "–"


def percent_with_interval(rate: Rate) -> str:
    """Return a rate with its interval for a table."""
    low, high = rate.interval
    return f"{percent(rate)} ({100 * low:.0f}–{100 * high:.0f})" if rate.of else "–"


def with_interval(found: Median, form: str, unit: str, scale: float = 1.0) -> str:
    """Return a median, times ``scale``, with its interval and unit; a dash of none."""
    if math.isnan(found.value):
        return "–"
    low, high = found.interval
    ends = "" if math.isnan(low) else f" ({scale * low:{form}}–{scale * high:{form}})"
    return f"{scale * found.value:{form}}{unit}{ends}"
