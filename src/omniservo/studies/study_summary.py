"""What the rows of a study say of each method."""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import numpy as np

from omniservo.studies.study_row import StudyRow

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


@dataclass(frozen=True)
class MethodSummary:
    """One method over all rows that count."""

    method: str
    success: Rate
    collision: Rate
    """of the rows with an obstacle"""
    feature_lost: Rate
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

    def to_dict(self) -> dict[str, object]:
        """Return everything as JSON has it."""
        rates = {name: getattr(self, name).to_dict() for name in ("success", "collision", "feature_lost")}
        return {**vars(self), **rates}


def summaries(rows: Sequence[StudyRow]) -> list[MethodSummary]:
    """Return a summary of each method, in the order in which the rows have them."""
    methods = dict.fromkeys(row.method for row in rows)
    return [_summary(name, [row for row in rows if row.method == name and row.counts]) for name in methods]


def _summary(method: str, rows: list[StudyRow]) -> MethodSummary:
    good = [row for row in rows if row.success]
    beside = [row for row in rows if row.obstacles]
    statuses = {s: sum(row.status == s for row in rows) for s in sorted({row.status for row in rows})}
    return MethodSummary(
        method=method,
        success=Rate(len(good), len(rows)),
        collision=Rate(sum(row.collision for row in beside), len(beside)),
        feature_lost=Rate(sum(row.feature_lost for row in rows), len(rows)),
        statuses=statuses,
        translation_m=_median(row.final_translation_error_m for row in good),
        rotation_rad=_median(row.final_rotation_error_rad for row in good),
        path_length_m=_median(row.path_length_m for row in good),
        seconds=_median(row.seconds for row in good),
    )


def _median(values: Iterable[float | None]) -> float:
    known = [value for value in values if value is not None]
    return float(np.median(known)) if known else math.nan


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
