"""SNOPT (Gill, Murray, Saunders) through Drake's MathematicalProgram.

All constraints at all samples are one vector-valued evaluator with exact gradients: Numba kernels, called
from Python, whose values and gradients are handed over as Drake's AutoDiffXd. Rows that keep more than
`ASLEEP` at the start are left out; after the solve every row is looked at, and where one is violated it joins
and SNOPT goes on from where it is. That is about ten times faster than all rows at once. The bending energy
is a quadratic cost (C++).

Not counted: the import and the compilation of the kernels. Counted: everything from the first solve on,
Drake's own building of the program (about 0.2 ms) included. The time limit is looked at between solves.
"""

from __future__ import annotations

from time import perf_counter

import numpy as np
from benchmarks.comparisons.planning.attempt import Attempt
from benchmarks.comparisons.planning.neutral import Neutral
from benchmarks.comparisons.planning.path_space import PathSpace
from benchmarks.comparisons.planning.peers.compiled_rows import CompiledRows
from benchmarks.comparisons.planning.peers.local_search import (
    FIRST,
    Descent,
    Settings,
    floors,
    multistart,
    sample_places,
)
from pydrake.autodiffutils import ExtractValue, InitializeAutoDiff
from pydrake.solvers import MathematicalProgram, SnoptSolver, SolverOptions

from omniservo.geometry.arrays import BoolArray, FloatArray
from omniservo.planning import PlanningProblem

CALLBACKS = "Numba, called from Python"

ASLEEP = 0.1
"""Rows with more left at the start are not given to SNOPT, unless its answer violates them."""

TOLERANCE = 1e-6
"""Violation of a row that counts as none: SNOPT's own feasibility tolerance."""

ROUNDS = 6
"""Solves at most from one start."""


def solve(problem: PlanningProblem, neutral: Neutral, budget: float, settings: Settings = FIRST) -> Attempt:
    """Return the path of the first start (straight line, then detours) that SNOPT calls optimal."""
    return multistart(neutral, lambda space: _descent(space, settings), settings, budget)


def _descent(space: PathSpace, settings: Settings) -> Descent:
    rows, least = CompiledRows(space, sample_places(settings)), floors(space, settings.margin)

    def descend(start: FloatArray, seconds: float) -> tuple[FloatArray, bool]:
        deadline = perf_counter() + seconds
        awake = rows.values(start) - least < ASLEEP
        x, good = start, True
        for _ in range(ROUNDS):
            x, good = _run(rows, space, settings, awake, least, x)
            violated = ~awake & (rows.values(x) - least < -TOLERANCE)
            if not violated.any():
                return x, good
            if perf_counter() > deadline:
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
    """Solve once with the rows that are awake; tell whether SNOPT calls it a success."""
    program = MathematicalProgram()
    x = program.NewContinuousVariables(space.size)
    lower = np.broadcast_to(least, awake.shape)[awake]

    def evaluate(v: FloatArray) -> FloatArray:
        given = ExtractValue(v).ravel() if v.dtype == object else v
        g, jacobian = rows.linearised(given, awake)
        # SNOPT asks for derivatives with respect to x itself, in its order: no chain rule is left to apply.
        return InitializeAutoDiff(g, jacobian).ravel() if v.dtype == object else g

    if lower.size:
        program.AddConstraint(evaluate, lower, np.full(lower.size, np.inf), x)
    if settings.effort:
        program.AddQuadraticCost(2.0 * space.bending, np.zeros(space.size), x, is_convex=True)
    options = SolverOptions()
    options.SetOption(SnoptSolver.id(), "Major iterations limit", 200)
    result = SnoptSolver().Solve(program, start, options)
    return np.array(result.GetSolution(x), dtype=np.float64), bool(result.is_success())
