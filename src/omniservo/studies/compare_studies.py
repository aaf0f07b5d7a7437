"""Two studies side by side, method by method."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

from omniservo.errors import InputError
from omniservo.studies.study_row import StudyRow
from omniservo.studies.study_summary import Rate, summaries


@dataclass(frozen=True)
class MethodDifference:
    """The success of one method in two studies."""

    method: str
    before: Rate
    after: Rate
    lost: tuple[int, ...]
    """rows that succeeded before and do not after; only where both ran the same study"""
    won: tuple[int, ...]
    """the other way round"""

    @property
    def interval(self) -> tuple[float, float]:
        """Newcombe's interval (1998) of 95% of the difference of both shares, from their Wilson intervals."""
        (a, b), (low_a, high_a), (low_b, high_b) = (
            (self.before.share, self.after.share), self.before.interval, self.after.interval,
        )  # fmt: skip
        below = math.sqrt((b - low_b) ** 2 + (high_a - a) ** 2)
        above = math.sqrt((high_b - b) ** 2 + (a - low_a) ** 2)
        return b - a - below, b - a + above

    @property
    def differs(self) -> bool:
        """Whether the interval leaves out zero."""
        low, high = self.interval
        return low > 0.0 or high < 0.0

    def to_dict(self) -> dict[str, object]:
        """Return everything as JSON has it."""
        return {
            "method": self.method,
            "before": self.before.to_dict(),
            "after": self.after.to_dict(),
            "difference": self.after.share - self.before.share,
            "interval_95": list(self.interval),
            "differs": self.differs,
            "lost": list(self.lost),
            "won": list(self.won),
        }


def compare_studies(before: Sequence[StudyRow], after: Sequence[StudyRow]) -> list[MethodDifference]:
    """Return the differences of the methods that both have.

    Raises:
        InputError: they have no method in common.
    """
    same = before[0].study_hash == after[0].study_hash
    first = {found.method: found.success for found in summaries(before)}
    second = {found.method: found.success for found in summaries(after)}
    common = [method for method in first if method in second and first[method].of and second[method].of]
    if not common:
        raise InputError(f"no method in common: {', '.join(first)} and {', '.join(second)}")
    pairs = list(zip(before, after, strict=True)) if same else []
    found = []
    for method in common:
        own = [(a, b) for a, b in pairs if a.method == method]
        lost = tuple(a.row for a, b in own if a.success and not b.success)
        won = tuple(a.row for a, b in own if b.success and not a.success)
        found.append(MethodDifference(method, first[method], second[method], lost, won))
    return found
