"""From rows to what a table says of a method on a set."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from benchmarks.comparisons.planning.methods import Method
from benchmarks.comparisons.planning.runner import Row

from omniservo.geometry.arrays import FloatArray

OURS = "effort"
"""The method that bending energies are compared with."""

STRAIGHT = 1e-9
"""Energy below which a path is straight: no ratio is taken."""


@dataclass(frozen=True)
class Summary:
    """One method on one set."""

    set: str
    method: Method
    problems: int
    """that it was given"""
    solvable: int
    """of these, solved by any method, or by ours in 1000 starts"""
    claimed: int
    feasible: int
    violated: int
    """claimed, and a w shows a violation"""
    seconds: FloatArray
    """of all its calls"""
    times: FloatArray
    """of those that gave a feasible path, in order"""
    energy: float
    """median, of feasible paths"""
    ratios: FloatArray
    """energy over that of `OURS`, where both are feasible and not straight"""
    length: float
    """median [m]"""
    least: tuple[float, float]
    """of feasible paths' smallest g: median, smallest"""
    clearance: float
    """smallest proven margin in metres beyond what is asked for [m]"""
    visibility: float
    """the same in px"""
    verifier: FloatArray
    """seconds of the verifier"""

    @property
    def success(self) -> float:
        """Feasible ones of the solvable."""
        return self.feasible / max(self.solvable, 1)


def summaries(rows: Sequence[Row], methods: Sequence[Method]) -> list[Summary]:
    """Return one summary for each set and method that has rows."""
    found = []
    for name in dict.fromkeys(row.set for row in rows):
        mine = [row for row in rows if row.set == name]
        solvable = {row.index for row in mine if row.score.feasible}
        energies = {row.index: row.score.energy for row in mine if row.method == OURS and row.score.feasible}
        for method in methods:
            given = [row for row in mine if row.method == method.name]
            if given:
                found.append(_summary(name, method, given, solvable, energies))
    return found


def _summary(
    name: str, method: Method, rows: list[Row], solvable: set[int], energies: dict[int, float]
) -> Summary:
    good = [row for row in rows if row.score.feasible]
    pairs = [(row.score.energy, energies.get(row.index, 0.0)) for row in good]
    least = np.array([row.score.least for row in good])
    return Summary(
        set=name,
        method=method,
        problems=len(rows),
        solvable=sum(row.index in solvable for row in rows),
        claimed=sum(row.score.claimed for row in rows),
        feasible=len(good),
        violated=sum(row.score.claimed and row.score.violated for row in rows),
        seconds=np.array([row.seconds for row in rows]),
        times=np.sort([row.seconds for row in good]),
        energy=_median([row.score.energy for row in good]),
        ratios=np.array([a / b for a, b in pairs if b > STRAIGHT]),
        length=_median([row.score.length for row in good]),
        least=(_median(list(least)), float(np.min(least, initial=np.inf))),
        clearance=float(np.fmin.reduce([np.nan, *(row.score.clearance for row in good)])),
        visibility=float(np.fmin.reduce([np.nan, *(row.score.visibility for row in good)])),
        verifier=np.array([row.score.verifier_seconds for row in good]),
    )


def _median(values: list[float]) -> float:
    known = [value for value in values if np.isfinite(value)]
    return float(np.median(known)) if known else np.nan


def quantile(values: FloatArray, part: float) -> float:
    """Return a quantile of the finite values; NaN of none."""
    known = values[np.isfinite(values)]
    return float(np.quantile(known, part)) if known.size else np.nan
