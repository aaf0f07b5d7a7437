"""SLSQP (Kraft) in SciPy: least bending energy, every constraint kept at samples, with exact gradients.

The solver is compiled (C); constraint and gradient are one call each of Numba kernels from Python. Rows that
keep more than `ASLEEP` at the start are left out; after the solve every row is looked at, and if one is
violated it joins and SLSQP goes on from where it is.
"""

from __future__ import annotations

from time import perf_counter

import numpy as np
from benchmarks.comparisons.planning.attempt import Attempt
from benchmarks.comparisons.planning.neutral import Neutral
from benchmarks.comparisons.planning.path_space import PathSpace
from benchmarks.comparisons.planning.peers.compiled_rows import CompiledRows
from benchmarks.comparisons.planning.peers.local_search import (
    DENSE,
    Descent,
    Settings,
    floors,
    multistart,
    sample_places,
)
from scipy.optimize import minimize

from omniservo.geometry.arrays import BoolArray, FloatArray
from omniservo.planning import PlanningProblem

CALLBACKS = "Numba, called from Python"

ASLEEP = 0.1
"""Rows with more left at the start are not given to SLSQP, unless its answer violates them."""

TOLERANCE = 1e-6
"""Violation of a row that counts as none: SLSQP's own accuracy."""

ROUNDS = 6
"""Solves at most from one start."""


def solve(problem: PlanningProblem, neutral: Neutral, budget: float, settings: Settings = DENSE) -> Attempt:
    """Return the path of the first start (straight line, then detours) with which SLSQP succeeds."""
    return multistart(neutral, lambda space: _descent(space, settings), settings, budget)


def _descent(space: PathSpace, settings: Settings) -> Descent:
    rows, least = CompiledRows(space, sample_places(settings)), floors(space, settings.margin)

    def descend(start: FloatArray, seconds: float) -> tuple[FloatArray, bool]:
        deadline = perf_counter() + seconds
        awake = rows.values(start) - least < ASLEEP
        x, good = start, True
        for _ in range(ROUNDS):
            if awake.any() or settings.effort:
                x, good = _run(rows, space, settings, awake, least, x)
            violated = rows.values(x) - least < -TOLERANCE
            if not violated.any():
                return x, good
            if perf_counter() > deadline or not (violated & ~awake).any():
                break
            awake |= violated
        return x, False

    return descend


def _run(
    rows: CompiledRows,
    space: PathSpace,
    settings: Settings,
    awake: BoolArray,
    least: FloatArray,
    start: FloatArray,
) -> tuple[FloatArray, bool]:
    """Solve once with the rows that are awake; tell whether SLSQP calls it a success."""
    lower = np.broadcast_to(least, awake.shape)[awake]
    twice = 2.0 * space.bending if settings.effort else np.zeros_like(space.bending)
    result = minimize(
        lambda x: 0.5 * float(x @ twice @ x),
        start,
        jac=lambda x: twice @ x,
        constraints={
            "type": "ineq",
            "fun": lambda x: rows.linearised(x, awake)[0] - lower,
            "jac": lambda x: rows.linearised(x, awake)[1],
        },
        method="SLSQP",
        options={"maxiter": 200, "ftol": 1e-9},
    )
    return result.x, bool(result.success)
