"""How much more bending energy ours has than SNOPT's best, on the first problems of the random sets.

Run: ``python -m benchmarks.comparisons.planning.effort_ratio [--count N] [SET …]``. Both start from the
straight line and from detours: ours is the best of `SEVERAL` proven starts, and by itself the first one;
SNOPT's is the best of its starts at 100 samples. Its paths violate active constraints a little between
samples, which ours may not: that gains about 1e-4 of the energy (median; at 25 samples 2e-3). Left out are
problems where SNOPT's path misses something by more, as past a thin obstacle between two samples, and those
whose straight path is good.
"""

from __future__ import annotations

import argparse
from collections.abc import Iterator
from time import perf_counter
from typing import NamedTuple

import numpy as np
from benchmarks.comparisons.planning.dense_check import look
from benchmarks.comparisons.planning.neutral import neutral_of
from benchmarks.comparisons.planning.peers import snopt
from benchmarks.comparisons.planning.peers.local_search import DENSE_BEST
from benchmarks.comparisons.planning.scoring import energy
from benchmarks.comparisons.planning.sets import problems
from benchmarks.comparisons.planning.targets import TOLERATED

from omniservo.planning import CameraPath, PlanningProblem
from omniservo.planning.search.problem_search import ProblemSearch

SETS = ("fisheye", "perspective", "catadioptric", "occlusion")
SEVERAL = 8
"""Proven starts of ours that are compared."""
NOTHING = 1e-6
"""An energy below it is that of a straight path."""
BUDGET = 20.0
"""a problem, for SNOPT [s]"""


class Efforts(NamedTuple):
    """Energies and times [s] on one problem; a NaN energy: no path."""

    first: float
    several: float
    snopt: float
    first_seconds: float
    several_seconds: float
    snopt_seconds: float


def efforts(problem: PlanningProblem) -> Efforts:
    """Return what ours and SNOPT find."""
    neutral, found, taken = neutral_of(problem), [], []
    for economised in (1, SEVERAL):
        search = ProblemSearch.of(problem)
        begin = perf_counter()
        ours = search.run(0, search.starts, economised)
        taken.append(perf_counter() - begin)
        found.append(energy(neutral, ours.path) if ours.proven else np.nan)
    theirs = snopt.solve(problem, neutral, BUDGET, DENSE_BEST)
    reference = np.nan
    if (
        theirs.claimed
        and isinstance(theirs.path, CameraPath)
        and look(neutral, theirs.path).least > TOLERATED
    ):
        reference = energy(neutral, theirs.path)
    return Efforts(*found, reference, *taken, theirs.seconds)


def lines(name: str, count: int) -> Iterator[str]:
    """Give the lines of the table for one set."""
    table = np.array([efforts(problem) for problem in problems(name, count)])
    both = np.all(np.isfinite(table[:, :3]), axis=1) & (table[:, 2] > NOTHING)
    times = 1e3 * np.median(table[both, 3:], axis=0)
    for label, column in (("first start", 0), (f"best of {SEVERAL}", 1)):
        ratio = table[both, column] / table[both, 2]
        middle, high = np.percentile(ratio, [50, 95])
        yield (
            f"{name:<14} {label:<12} {both.sum():>4} {middle:>9.4f} {high:>9.4f} {ratio.max():>9.3f} "
            f"{np.mean(ratio < 1.0 - 1e-3):>8.0%} {times[column]:>10.2f} {times[2]:>10.1f}"
        )


def main() -> None:
    """Print the ratios ours/SNOPT."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("sets", nargs="*", default=SETS, metavar="SET")
    parser.add_argument("--count", type=int, default=100)
    given = parser.parse_args()
    print(
        f"{'set':<14} {'ours':<12} {'n':>4} {'median':>9} {'p95':>9} {'worst':>9} "
        f"{'better':>8} {'ours [ms]':>10} {'SNOPT [ms]':>10}"
    )
    for name in given.sets:
        for line in lines(name, given.count):
            print(line, flush=True)


if __name__ == "__main__":
    main()
