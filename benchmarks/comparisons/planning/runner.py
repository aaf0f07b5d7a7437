"""Runs every method on every problem, by turns, so that a drift of the machine hits all alike."""

from __future__ import annotations

import gc
from collections.abc import Callable, Iterator, Sequence
from dataclasses import asdict, dataclass, replace
from time import perf_counter

import numpy as np
from benchmarks.comparisons.planning.attempt import Attempt
from benchmarks.comparisons.planning.methods import NEEDS_SPHERES, Method, many_starts
from benchmarks.comparisons.planning.neutral import Neutral, neutral_of
from benchmarks.comparisons.planning.scoring import Score, score
from benchmarks.comparisons.planning.sets import problem

from omniservo.planning import PlanningProblem, Sphere

SHORT = 0.02
"""A method that takes less is called again, until it has taken so long [s] …"""

CALLS = 200
"""… or has been called so often; its time is the median, the first call not counted."""

LARGE = {"wall": 0.2}
"""Sets of large problems: a method that is not given all of a set gets this part of what it else would."""

WARM_UP = 2
"""Problems of a set that are run once before any is measured: kernels are compiled then. Slow peers: one."""


@dataclass(frozen=True)
class Row:
    """One method on one problem."""

    set: str
    index: int
    method: str
    seconds: float
    calls: int
    note: str
    facts: dict[str, float]
    score: Score

    def flat(self) -> dict[str, object]:
        """Return the row as one level of fields."""
        fields = asdict(self)
        return fields | fields.pop("score") | fields.pop("facts")


def measured(
    method: Method, one: PlanningProblem, neutral: Neutral, clock: Callable[[], float] = perf_counter
) -> tuple[Attempt, int]:
    """Return an attempt with the median of its seconds over some calls, and their number."""
    begin = clock()
    attempt = method.solve(one, neutral, method.budget)
    if clock() - begin > SHORT:
        return attempt, 1
    taken: list[float] = []
    begin = clock()
    while len(taken) < CALLS and clock() - begin < SHORT:
        taken.append(method.solve(one, neutral, method.budget).seconds)
    return replace(attempt, seconds=float(np.median(taken))), len(taken)


def takes(method: Method, one: PlanningProblem, name: str, index: int) -> bool:
    """Tell whether a method is given problem ``index`` of the set ``name``."""
    if method.most is not None and index >= max(1.0, LARGE.get(name, 1.0) * method.most):
        return False
    return method.name not in NEEDS_SPHERES or all(isinstance(o, Sphere) for o in one.obstacles)


def run_set(name: str, methods: Sequence[Method], count: int) -> Iterator[Row]:
    """Give one row for each method and problem; the methods begin by turns."""
    for index in range(min(WARM_UP, count)):
        one = problem(name, index)
        for method in methods:
            if takes(method, one, name, index) and (method.most is None or index == 0):
                method.solve(one, neutral_of(one), method.budget)
    for index in range(count):
        one = problem(name, index)
        neutral, rows = neutral_of(one), []
        gc.collect()
        gc.disable()
        for k in range(len(methods)):
            method = methods[(index + k) % len(methods)]
            if takes(method, one, name, index):
                rows.append(_row(name, index, method, one, neutral))
        gc.enable()
        yield from rows
        if not any(row.score.feasible for row in rows):
            yield _solvable(name, index, one, neutral)


def _row(name: str, index: int, method: Method, one: PlanningProblem, neutral: Neutral) -> Row:
    try:
        attempt, calls = measured(method, one, neutral)
    except Exception as error:  # a peer that fails is a row, not the end of the run
        attempt, calls = Attempt(False, None, np.nan, f"{type(error).__name__}: {error}"), 1
    judged = score(one, neutral, attempt)
    return Row(name, index, method.name, attempt.seconds, calls, attempt.note, attempt.facts, judged)


MANY = "many-starts"
"""The row of a problem that no method solves: ours with 1000 starts, for the denominator only."""


def _solvable(name: str, index: int, one: PlanningProblem, neutral: Neutral) -> Row:
    path = many_starts(one)
    attempt = Attempt(path is not None, path, 0.0)
    return Row(name, index, MANY, 0.0, 1, "", {}, score(one, neutral, attempt))
