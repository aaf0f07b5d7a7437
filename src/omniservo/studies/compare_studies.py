"""Two studies side by side, method by method."""

from __future__ import annotations

import math
from collections import defaultdict
from collections.abc import Iterable
from dataclasses import dataclass
from itertools import zip_longest

from omniservo.errors import InputError
from omniservo.studies.study_row import StudyRow
from omniservo.studies.study_summary import Rate
from omniservo.studies.study_tally import StudyTally


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


def compare_studies(before: Iterable[StudyRow], after: Iterable[StudyRow]) -> list[MethodDifference]:
    """Return the differences of the methods that both have; rows are read once, and not kept.

    Raises:
        InputError: they have no method in common.
    """
    first, second = StudyTally(), StudyTally()
    lost: dict[str, list[int]] = defaultdict(list)
    won: dict[str, list[int]] = defaultdict(list)
    for a, b in zip_longest(before, after):
        for tally, row in ((first, a), (second, b)):
            if row is not None:
                tally.add(row)
        if a and b and (a.study_hash, a.row) == (b.study_hash, b.row) and a.success != b.success:
            (lost if a.success else won)[a.method].append(a.row)
    rates = [{found.method: found.success for found in tally.summaries()} for tally in (first, second)]
    common = [method for method in rates[0] if method in rates[1] and all(rate[method].of for rate in rates)]
    if not common:
        raise InputError(f"no method in common: {', '.join(rates[0])} and {', '.join(rates[1])}")
    return [
        MethodDifference(method, rates[0][method], rates[1][method], tuple(lost[method]), tuple(won[method]))
        for method in common
    ]
