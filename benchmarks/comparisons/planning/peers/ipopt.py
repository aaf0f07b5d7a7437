"""IPOPT (Wächter, Biegler) through CasADi, with MUMPS.

Exact Jacobian and Hessian by CasADi, all constraints at all samples (`ipopt_model`). Options were chosen on
the paper's examples and a few random problems: MUMPS orders by approximate minimum degree, which makes a step
three times cheaper than its default, as all rows share a few dense columns. Without an objective IPOPT stops
at the first point that keeps every row.

Not counted: the import, and the building of a model (``build_seconds``), once for each structure. The time
limit holds for each start; between starts it holds for all.
"""

from __future__ import annotations

import math
from functools import lru_cache
from typing import Any

import casadi as ca
import numpy as np
from benchmarks.comparisons.planning.attempt import Attempt
from benchmarks.comparisons.planning.neutral import Neutral
from benchmarks.comparisons.planning.path_space import PathSpace, bending_matrix
from benchmarks.comparisons.planning.peers.compiled_rows import row_count
from benchmarks.comparisons.planning.peers.ipopt_model import Structure, model_of, parameters_of, structure_of
from benchmarks.comparisons.planning.peers.local_search import (
    FIRST,
    Descent,
    Settings,
    floors,
    multistart,
    sample_places,
)

from omniservo.geometry.arrays import FloatArray
from omniservo.planning import PlanningProblem

CALLBACKS = "CasADi virtual machine (C++)"

MOST_ROWS = 10_000
"""More are not tried: with 12 325 (429 spheres at 25 samples) a solve did not keep its time limit, by far."""

_COMMON: dict[str, Any] = {
    "print_time": False,
    "error_on_fail": False,
    "calc_lam_p": False,
    "ipopt.print_level": 0,
    "ipopt.sb": "yes",
    "ipopt.max_iter": 100,
    "ipopt.mumps_pivot_order": 0,
    "ipopt.mu_strategy": "adaptive",
}
_EFFORT = {"ipopt.mu_oracle": "probing", "ipopt.tol": 1e-6}
_FIRST = {
    "ipopt.tol": 1e-2,
    "ipopt.dual_inf_tol": 1e3,
    "ipopt.compl_inf_tol": 1e3,
    "ipopt.constr_viol_tol": 1e-9,
}


def solve(problem: PlanningProblem, neutral: Neutral, budget: float, settings: Settings = FIRST) -> Attempt:
    """Return the path of the first start (straight line, then detours) that IPOPT calls solved."""
    rows = settings.samples * row_count(neutral)
    if rows > MOST_ROWS:
        return Attempt(False, None, math.nan, f"{rows} rows: not tried, see MOST_ROWS")
    seconds = math.ceil(budget)
    return multistart(neutral, lambda space: _descent(space, settings, seconds), settings, budget)


def _descent(space: PathSpace, settings: Settings, seconds: int) -> Descent:
    solver = solver_of(structure_of(space), settings.samples, settings.effort, seconds)
    parameters = parameters_of(space.neutral)
    lower = np.tile(floors(space, settings.margin), settings.samples)

    def descend(start: FloatArray, _: float) -> tuple[FloatArray, bool]:
        found = solver(x0=start, p=parameters, lbg=lower, ubg=math.inf)
        return np.array(found["x"]).ravel(), bool(solver.stats()["success"])

    return descend


@lru_cache(maxsize=64)
def solver_of(structure: Structure, samples: int, effort: bool, seconds: int) -> Any:
    """Return the solver of a structure with a time limit [s]."""
    model = model_of(structure, sample_places(Settings(samples=samples)))
    turns = 4 * (structure.sigma - 1)
    f = ca.SX(0.0)
    if effort:
        f += _energy(model.x[:turns], 4, structure.sigma) + _energy(model.x[turns:], 3, structure.tau)
    options = _COMMON | (_EFFORT if effort else _FIRST) | {"ipopt.max_wall_time": float(seconds)}
    return ca.nlpsol("path", "ipopt", {"x": model.x, "p": model.parameters, "f": f, "g": model.g}, options)


def _energy(x: Any, width: int, degree: int) -> Any:
    """Return the bending energy of inner control points (width·(degree−1),)."""
    if degree < 2:
        return 0.0
    blocks = ca.reshape(x, width, degree - 1)
    return ca.dot(blocks @ ca.DM(bending_matrix(degree)), blocks)
