"""The methods that the benchmark compares, by name."""

from __future__ import annotations

import importlib
from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from time import perf_counter

from benchmarks.planning.attempt import Attempt
from benchmarks.planning.neutral import Neutral

from omniservo.planning import CameraPath, PlanningProblem, plan_path
from omniservo.planning.paper_search import paper_path
from omniservo.planning.problem_search import ProblemSearch

Solve = Callable[[PlanningProblem, Neutral, float], Attempt]

SEVERAL = 8
"""Starts that "best of several" economises."""

FOR_DENOMINATOR = 1000
"""Starts that ours is given where no method has solved a problem."""


@dataclass(frozen=True)
class Method:
    """One row of the tables."""

    name: str
    label: str
    runs_in: str
    """the language that its constraints are evaluated in"""
    solve: Solve
    most: int | None = None
    """problems of a set that it is given, the first ones; None: all"""
    budget: float = 10.0
    """a problem [s]"""


def kernel(economised: int, problem: PlanningProblem, neutral: Neutral, budget: float) -> Attempt:
    """Ours, arrays in, coefficients and verdict out. ``economised``: see `ProblemSearch.run`."""
    search = ProblemSearch.of(problem)
    begin = perf_counter()
    found = search.run(0, search.starts, economised)
    seconds = perf_counter() - begin
    return Attempt(found.proven, found.path, seconds, facts={"start": float(found.number)})


def public(problem: PlanningProblem, neutral: Neutral, budget: float) -> Attempt:
    """Ours, a problem in, a plan with every margin out."""
    begin = perf_counter()
    plan = plan_path(problem)
    seconds = perf_counter() - begin
    return Attempt(plan.status == "certified", plan.path, seconds, plan.reason)


def many_starts(problem: PlanningProblem) -> CameraPath | None:
    """Return what ours finds in `FOR_DENOMINATOR` starts."""
    found = ProblemSearch.of(problem).run(0, FOR_DENOMINATOR, 0)
    return found.path if found.proven else None


def paper_numpy(problem: PlanningProblem, neutral: Neutral, budget: float) -> Attempt:
    """The paper's search (36)–(38) at degree 2, in NumPy; it knows spheres only, and no occlusion."""
    from benchmarks.planning.peers.paper_compiled import quadratic, sampled_value

    given = quadratic(problem)
    begin = perf_counter()
    path, note = paper_path(given)
    seconds = perf_counter() - begin
    return Attempt(sampled_value(problem, path) > 0.0, path, seconds, note)


_PEERS: tuple[tuple[str, str, str, str | None, int | None, float], ...] = (
    ("paper-compiled", "the paper's search, compiled", "paper_compiled", None, None, 10.0),
    ("slsqp", "SLSQP, 100 samples", "slsqp", "DENSE", None, 5.0),
    ("slsqp-margin", "SLSQP, 100 samples, margin 0.005", "slsqp", "DENSE_WITH_MARGIN", None, 5.0),
    ("snopt-first", "SNOPT, any path, 25 samples", "snopt", "FIRST_WITH_MARGIN", None, 5.0),
    ("snopt", "SNOPT, least effort, 25 samples", "snopt", "EFFORT", None, 5.0),
    ("snopt-margin", "SNOPT, 25 samples, margin 0.005", "snopt", "EFFORT_WITH_MARGIN", None, 5.0),
    ("snopt-best", "SNOPT, 100 samples, best of 8 starts", "snopt", "DENSE_BEST", 100, 10.0),
    ("ipopt", "IPOPT, 25 samples", "ipopt", "EFFORT", 30, 20.0),
    ("ipopt-dense", "IPOPT, 100 samples", "ipopt", "DENSE", 10, 30.0),
    ("rrtconnect", "RRTConnect, Python checker", "rrtconnect", None, 100, 5.0),
)
"""name, label, module, settings in `peers.local_search`, problems of a set, budget [s]"""

NEEDS_SPHERES = frozenset({"paper-numpy", "paper-compiled"})
"""Methods that are not given sets with other obstacles."""


def ours() -> list[Method]:
    """Return ours: first path and least effort, kernel and public call."""
    return [
        Method("first", "ours, first path (kernel)", "Numba", partial(kernel, 0)),
        Method("effort", "ours, least effort (kernel)", "Numba", partial(kernel, 1)),
        Method("best", f"ours, best of {SEVERAL} starts (kernel)", "Numba", partial(kernel, SEVERAL)),
        Method("public", "ours, least effort (`plan_path`)", "Numba", public),
    ]


def all_methods() -> tuple[list[Method], dict[str, str]]:
    """Return every method whose library is there, and why the others are not: name → reason."""
    found, missing = ours(), {}
    found.append(Method("paper-numpy", "the paper's search, NumPy", "NumPy", paper_numpy, 200))
    for name, label, module, settings, most, budget in _PEERS:
        try:
            peer = importlib.import_module(f"benchmarks.planning.peers.{module}")
            solve = peer.solve
            if settings is not None:
                common = importlib.import_module("benchmarks.planning.peers.local_search")
                solve = partial(peer.solve, settings=getattr(common, settings))
        except ImportError as error:
            missing[name] = str(error)
            continue
        found.append(Method(name, label, peer.CALLBACKS, solve, most, budget))
    return found, missing
