"""What the rows of a study say of each method."""

from __future__ import annotations

import math
from dataclasses import dataclass

_Z = 1.959963984540054
"""standard deviations that a two-sided interval of 95% reaches to"""


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


RATES = ("success", "collision", "joint_limit", "feature_lost", "diverged")


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
    translation_m: float
    """median final error of the successful runs; NaN of none"""
    rotation_rad: float
    """likewise"""
    path_length_m: float
    """median of the successful runs"""
    seconds: float
    """likewise, of the run"""
    arms: dict[str, ArmRates]
    """by the arms that rows have, "none" among them"""

    def to_dict(self) -> dict[str, object]:
        """Return everything as JSON has it."""
        rates = {name: getattr(self, name).to_dict() for name in RATES}
        arms = {name: of_arm.to_dict() for name, of_arm in self.arms.items()}
        return {**vars(self), **rates, "arms": arms}


def percent(rate: Rate) -> str:
    """Return a rate for a table."""
    return f"{100 * rate.share:.1f}%" if rate.of else "–"


def errors(found: MethodSummary) -> str:
    """Return the median final errors for a table."""
    if math.isnan(found.translation_m):
        return "–"
    return f"{1e3 * found.translation_m:.1f} mm, {math.degrees(found.rotation_rad):.2f}°"


def number(value: float, form: str, unit: str) -> str:
    """Return a number with its unit; a dash for NaN."""
    return "–" if math.isnan(value) else f"{value:{form}}{unit}"
