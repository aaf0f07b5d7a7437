"""Time of the first proven path against the number of target points, and past a cloud of points."""

from __future__ import annotations

from dataclasses import replace
from functools import partial

import numpy as np
from benchmarks.planning.draws import Draws
from benchmarks.planning.sets import problem
from benchmarks.planning_speed import median_seconds

import omniservo.planning as planning
from omniservo.planning import PlanningProblem
from omniservo.planning.search.problem_search import ProblemSearch

COUNTS = (9, 50, 200, 1000)
"""Target points."""

CLOUD = 10_000
"""Points of the cloud."""


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


def with_cloud() -> PlanningProblem | None:
    """Return example 1 past a ball and over a floor, `CLOUD` points together; None without clouds."""
    kind = getattr(planning, "Cloud", None)
    if kind is None:
        return None
    one, draws = problem("paper", 0), Draws("cloud", CLOUD)
    middle = np.mean([o.center for o in one.obstacles], axis=0)
    ball = middle + 0.01 * np.array([draws.direction() for _ in range(CLOUD // 2)])
    floor = draws.numbers(-0.5, 0.5, CLOUD - len(ball), 3) * [1.0, 0.01, 1.0] + [0.0, 0.25, 0.0]
    return replace(one, obstacles=(kind(points=np.vstack([ball, floor])),), clearance=0.05)


def scaling() -> dict[str, float]:
    """Return name → seconds."""
    found = {f"n = {count}": kernel_seconds(with_points(count)) for count in COUNTS}
    cloud = with_cloud()
    return found if cloud is None else found | {"cloud": kernel_seconds(cloud, 50)}
