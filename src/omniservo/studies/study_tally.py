"""What is kept of a study's rows while they are read once: counts, and a few numbers of each."""

from __future__ import annotations

import math
from array import array
from collections import Counter
from collections.abc import Iterable
from dataclasses import dataclass, field

from omniservo.studies.study_arms import NO_ARM
from omniservo.studies.study_row import StudyRow
from omniservo.studies.study_summary import ArmRates, Median, MethodSummary, Rate

_FIRST = 2
"""of a method's worst rows come before those of others: else a gallery shows the worst method alone"""
_KEPT = 10
"""of a method's worst rows"""

_COLLIDES = "something to collide with"

_MEDIANS = ("final_translation_error_m", "final_rotation_error_rad", "path_length_m", "seconds")


def _numbers() -> array[float]:
    return array("d")


@dataclass(eq=False)
class MethodTally:
    """The rows of one method, in 24 to 56 bytes each."""

    statuses: Counter[str] = field(default_factory=Counter)
    """how those that count ended"""
    stops: Counter[str] = field(default_factory=Counter)
    """names by which they were stopped"""
    counts: dict[str, Counter[str]] = field(default_factory=dict)
    """arm → how many of them with it are "rows", and have "success", "feature_lost", "diverged", a
    "collision", a "joint_limit", "something to collide with" """
    good: dict[str, array[float]] = field(default_factory=lambda: {name: _numbers() for name in _MEDIANS})
    """column → its numbers in the successful rows"""
    turned: array[float] = field(default_factory=_numbers)
    """start_rotation_rad of the rows that have a scene"""
    ratio: array[float] = field(default_factory=_numbers)
    """start_distance_ratio of the same"""
    reached: array[float] = field(default_factory=_numbers)
    """whether they succeeded"""
    worst: list[StudyRow] = field(default_factory=list)
    """of those without success, the worst first, at most `_KEPT`"""

    def add(self, row: StudyRow) -> None:
        """Count a row in."""
        if not row.counts:
            return
        self.statuses[row.status] += 1
        if row.status == "stopped":
            self.stops[row.reason.partition(":")[0]] += 1
        rates = rates_of(row)
        has = {**rates, "rows": True, _COLLIDES: "collision" in rates}
        self.counts.setdefault(row.arm, Counter()).update(name for name, holds in has.items() if holds)
        if row.start_rotation_rad is not None and row.start_distance_ratio is not None:
            self.turned.append(row.start_rotation_rad)
            self.ratio.append(row.start_distance_ratio)
            self.reached.append(row.success)
        if row.success:
            for name, numbers in self.good.items():
                value = getattr(row, name)
                numbers.append(math.nan if value is None else value)
        else:
            self.worst = sorted((*self.worst, row), key=badness)[:_KEPT]

    def summary(self, method: str) -> MethodSummary:
        """Return what the rows say of the method."""
        counts = sum(self.counts.values(), Counter())
        of, with_arm = counts["rows"], counts["rows"] - self.counts.get(NO_ARM, Counter())["rows"]
        translation, rotation, path_length, seconds = map(Median.of, self.good.values())
        return MethodSummary(
            method=method,
            success=Rate(counts["success"], of),
            collision=Rate(counts["collision"], counts[_COLLIDES]),
            joint_limit=Rate(counts["joint_limit"], with_arm),
            feature_lost=Rate(counts["feature_lost"], of),
            diverged=Rate(counts["diverged"], of),
            statuses=dict(sorted(self.statuses.items())),
            stops=dict(sorted(self.stops.items())),
            translation_m=translation,
            rotation_rad=rotation,
            path_length_m=path_length,
            seconds=seconds,
            arms={name: _rates_of(name, self.counts[name]) for name in sorted(self.counts)},
        )


def _rates_of(arm: str, counts: Counter[str]) -> ArmRates:
    of = counts["rows"]
    return ArmRates(
        success=Rate(counts["success"], of),
        collision=Rate(counts["collision"], counts[_COLLIDES]),
        joint_limit=Rate(counts["joint_limit"], 0 if arm == NO_ARM else of),
    )


def rates_of(row: StudyRow) -> dict[str, bool]:
    """Return the rates that a row is counted in, by the names of `RATES`, and whether it holds there."""
    rates = {"success": row.success, "feature_lost": row.feature_lost, "diverged": row.diverged}
    if row.obstacles > 0 or row.arm != NO_ARM:
        rates["collision"] = row.collision
    if row.arm != NO_ARM:
        rates["joint_limit"] = row.joint_limit
    return rates


def badness(row: StudyRow) -> tuple[int, float, int]:
    """Return by what rows without success are ordered, the worst first.

    Crashes, then collisions, then others by their final error; last those that nothing moved.
    """
    moved = 2 if row.images else 3
    kind = 0 if row.status == "error" else 1 if row.collision else moved
    return kind, -(row.final_translation_error_m or 0.0), row.row


class StudyTally:
    """Takes in a study's rows one by one; none of them is kept but the worst."""

    def __init__(self, rows: Iterable[StudyRow] = ()) -> None:
        self.rows = 0
        """that were added"""
        self.without = 0
        """of them without a scene: no rate counts them"""
        self.methods: dict[str, MethodTally] = {}
        """in the order in which the rows have them"""
        for row in rows:
            self.add(row)

    def add(self, row: StudyRow) -> None:
        """Count a row in."""
        self.rows += 1
        self.without += not row.counts
        self.methods.setdefault(row.method, MethodTally()).add(row)

    def summaries(self) -> list[MethodSummary]:
        """Return a summary of each method."""
        return [tally.summary(method) for method, tally in self.methods.items()]

    def worst(self, count: int) -> list[StudyRow]:
        """Return so many rows of the gallery, worst first: two of each method, then whatever is worst."""
        first = sorted((row for tally in self.methods.values() for row in tally.worst[:_FIRST]), key=badness)
        more = sorted((row for tally in self.methods.values() for row in tally.worst[_FIRST:]), key=badness)
        return sorted((first + more)[:count], key=badness)
