"""Time of the first proven path on the paper's examples, against the number of points, and past a cloud.

These are microseconds, and a machine that others share changes its speed from minute to minute: each is
measured in several passes, one before the sets and one after each of them.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from functools import partial

import numpy as np
from benchmarks.comparisons.planning.draws import Draws
from benchmarks.comparisons.planning.sets import problem
from benchmarks.planning_speed import median_seconds

from omniservo.planning import Cloud, PlanningProblem
from omniservo.planning.search.problem_search import ProblemSearch

COUNTS = (9, 50, 200, 1000)
"""Target points."""

CLOUD = 10_000
"""Points of the cloud."""

Passes = Mapping[str, list[float]]
"""Name → the median time of each pass [s]."""


class Scaling:
    """Problems of known sizes, and what their kernels took so far."""

    def __init__(self) -> None:
        """Make the problems."""
        self._problems = {f"example {index + 1}": problem("paper", index) for index in (0, 1)}
        self._problems |= {f"n = {count}": with_points(count) for count in COUNTS}
        self._problems["cloud"] = with_cloud()
        self.passes: Passes = {name: [] for name in self._problems}

    def measure(self) -> None:
        """Add one pass."""
        for name, one in self._problems.items():
            self.passes[name].append(kernel_seconds(one))


def kernel_seconds(one: PlanningProblem, calls: int = 200) -> float:
    """Return the median time of the kernel to the first proven path [s]; NaN where it finds none."""
    search = ProblemSearch.of(one)
    if not search.run(0, search.starts, 0).proven:
        return np.nan
    return median_seconds(partial(search.kernel, 0, search.starts, 0), calls)


def with_points(count: int) -> PlanningProblem:
    """Return the paper's example 1 with so many target points spread over its board."""
    one, draws = problem("paper", 0), Draws("points", count)
    least, most = one.points.min(axis=0), one.points.max(axis=0)
    spread = 0.05 + 0.9 * draws.numbers(0.0, 1.0, count, 3)
    return replace(one, points=least + spread * (most - least))


def with_cloud() -> PlanningProblem:
    """Return example 1 past a ball and over a floor, `CLOUD` points together."""
    one, draws = problem("paper", 0), Draws("cloud", CLOUD)
    middle = np.mean([o.center for o in one.obstacles], axis=0)
    ball = middle + 0.01 * np.array([draws.direction() for _ in range(CLOUD // 2)])
    floor = draws.numbers(-0.5, 0.5, CLOUD - len(ball), 3) * [1.0, 0.01, 1.0] + [0.0, 0.25, 0.0]
    return replace(one, obstacles=(Cloud(points=np.vstack([ball, floor])),), clearance=0.05)
