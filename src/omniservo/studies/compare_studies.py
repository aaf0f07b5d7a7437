"""Two studies side by side, method by method."""

from __future__ import annotations

import math
from collections import Counter, defaultdict
from collections.abc import Iterable
from dataclasses import dataclass
from itertools import zip_longest

from omniservo.errors import InputError
from omniservo.studies.study_row import StudyRow
from omniservo.studies.study_summary import MEDIANS, RATES, Median, MethodSummary, Rate
from omniservo.studies.study_tally import StudyTally, rates_of

Pairs = Counter[tuple[bool, bool]]
"""(before, after) → how many rows"""


@dataclass(frozen=True)
class RateDifference:
    """One share of a method's rows in two studies."""

    before: Rate
    after: Rate
    correlation: float = 0.0
    """φ of both over the rows that they share; 0 where they do not share all of them"""

    @classmethod
    def of(cls, before: Rate, after: Rate, pairs: Pairs) -> RateDifference:
        """Return that of two rates, and of how both came out row by row."""
        paired = 0 < pairs.total() == before.of == after.of
        return cls(before, after, _correlation(pairs) if paired else 0.0)

    @property
    def difference(self) -> float:
        """After less before; NaN of nothing."""
        return self.after.share - self.before.share

    @property
    def interval(self) -> tuple[float, float]:
        """Newcombe's interval (1998) of 95% of the difference, from both Wilson intervals.

        His method 10 for two samples, and that for pairs where both ran the same rows.
        """
        (a, b), (low_a, high_a), (low_b, high_b) = (
            (self.before.share, self.after.share), self.before.interval, self.after.interval,
        )  # fmt: skip
        below = _apart(b - low_b, high_a - a, self.correlation)
        above = _apart(high_b - b, a - low_a, self.correlation)
        return b - a - below, b - a + above

    @property
    def differs(self) -> bool:
        """Whether the interval leaves out zero."""
        low, high = self.interval
        return low > 0.0 or high < 0.0

    def to_dict(self) -> dict[str, object]:
        """Return everything as JSON has it."""
        return {
            "before": self.before.to_dict(),
            "after": self.after.to_dict(),
            "difference": self.difference,
            "interval_95": list(self.interval),
            "differs": self.differs,
        }


def _apart(one: float, other: float, correlation: float) -> float:
    return math.sqrt(max(one**2 + other**2 - 2.0 * correlation * one * other, 0.0))


def _correlation(pairs: Pairs) -> float:
    """Return φ as Newcombe has it, with his correction for continuity."""
    both, first, second = pairs[True, True], pairs[True, False], pairs[False, True]
    none = pairs[False, False]
    size = math.sqrt((both + first) * (second + none) * (both + second) * (first + none))
    if size == 0.0:
        return 0.0
    excess: float = both * none - first * second
    if excess > 0:
        excess = max(excess - 0.5 * pairs.total(), 0.0)
    return excess / size


@dataclass(frozen=True)
class MethodDifference:
    """One method in two studies."""

    method: str
    rates: dict[str, RateDifference]
    """by the names of `RATES`"""
    medians: dict[str, tuple[Median, Median]]
    """by the names of `MEDIANS`, before and after, each of the successful rows"""
    lost: tuple[int, ...]
    """rows that succeeded before and do not after; only where both ran the same study"""
    won: tuple[int, ...]
    """the other way round"""

    @property
    def success(self) -> RateDifference:
        """Of the rows that succeed."""
        return self.rates["success"]

    def to_dict(self) -> dict[str, object]:
        """Return everything as JSON has it."""
        others = {name: rate.to_dict() for name, rate in self.rates.items() if name != "success"}
        medians = {name: [before.value, after.value] for name, (before, after) in self.medians.items()}
        own = {"method": self.method, **self.success.to_dict(), "rates": others, "medians": medians}
        return {**own, "lost": list(self.lost), "won": list(self.won)}


def compare_studies(before: Iterable[StudyRow], after: Iterable[StudyRow]) -> list[MethodDifference]:
    """Return the differences of the methods that both have; rows are read once, and not kept.

    Raises:
        InputError: they have no method in common.
    """
    first, second = StudyTally(), StudyTally()
    lost: dict[str, list[int]] = defaultdict(list)
    won: dict[str, list[int]] = defaultdict(list)
    pairs: dict[tuple[str, str], Pairs] = defaultdict(Counter)
    for a, b in zip_longest(before, after):
        for tally, row in ((first, a), (second, b)):
            if row is not None:
                tally.add(row)
        if not (a and b and (a.study_hash, a.row) == (b.study_hash, b.row) and a.counts and b.counts):
            continue
        if a.success != b.success:
            (lost if a.success else won)[a.method].append(a.row)
        held, holds = rates_of(a), rates_of(b)
        for name in held.keys() & holds.keys():
            pairs[a.method, name][held[name], holds[name]] += 1
    found = [{each.method: each for each in tally.summaries()} for tally in (first, second)]
    common = [name for name in found[0] if name in found[1] and all(each[name].success.of for each in found)]
    if not common:
        named = " and ".join(
            ", ".join(name for name, e in each.items() if e.success.of) or "none" for each in found
        )
        raise InputError(f"no method in common that has rows with a scene: {named}")
    return [
        _difference(found[0][name], found[1][name], pairs, (tuple(lost[name]), tuple(won[name])))
        for name in common
    ]


def _difference(
    before: MethodSummary,
    after: MethodSummary,
    pairs: dict[tuple[str, str], Pairs],
    changed: tuple[tuple[int, ...], tuple[int, ...]],
) -> MethodDifference:
    method = before.method
    rates = {
        name: RateDifference.of(getattr(before, name), getattr(after, name), pairs[method, name])
        for name in RATES
    }
    medians = {name: (getattr(before, name), getattr(after, name)) for name in MEDIANS}
    return MethodDifference(method, rates, medians, *changed)
