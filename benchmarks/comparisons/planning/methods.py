"""The methods that the benchmark compares, by name."""

from __future__ import annotations

import importlib
from collections.abc import Callable
from dataclasses import dataclass
from functools import lru_cache, partial
from time import perf_counter
from typing import Any, NamedTuple

from benchmarks.comparisons.planning.attempt import Attempt
from benchmarks.comparisons.planning.neutral import Neutral

from omniservo.geometry.subdivision import PROVEN
from omniservo.planning import CameraPath, Plan, PlanningProblem, plan_path
from omniservo.planning.improving_plans import improving_plans
from omniservo.planning.paper_search import paper_path
from omniservo.planning.search.problem_search import ProblemSearch

Solve = Callable[[PlanningProblem, Neutral, float], Attempt]

BEST_PEER = "snopt-best"
"""The method that least effort is compared with."""

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
    """Ours, arrays in, coefficients and verdict out. ``economised``: see `ProblemSearch.kernel`."""
    search = _search(problem)
    starts = search.starts
    begin = perf_counter()
    status, rotation, translation, facts = search.kernel(0, starts, economised)
    seconds = perf_counter() - begin
    path = CameraPath(rotation, translation)
    return Attempt(status == PROVEN, path, seconds, facts={"start": float(facts[0])})


@lru_cache(maxsize=1)
def _search(problem: PlanningProblem) -> ProblemSearch:
    """Return the arrays of a problem, so that repeated calls follow one another at once."""
    return ProblemSearch.of(problem)


def public(plan_of: Callable[[PlanningProblem], Plan], problem: PlanningProblem, *_: object) -> Attempt:
    """Ours, a problem in, a plan with every margin out."""
    begin = perf_counter()
    plan = plan_of(problem)
    seconds = perf_counter() - begin
    return Attempt(plan.status == "certified", plan.path, seconds, plan.reason)


def first_plan(problem: PlanningProblem) -> Plan:
    """Return the first of ever better plans."""
    return next(improving_plans(problem))


def many_starts(problem: PlanningProblem) -> CameraPath | None:
    """Return what ours finds in `FOR_DENOMINATOR` starts."""
    found = ProblemSearch.of(problem).run(0, FOR_DENOMINATOR, 0)
    return found.path if found.proven else None


def paper_numpy(problem: PlanningProblem, neutral: Neutral, budget: float) -> Attempt:
    """The paper's search (36)–(38) at degree 2, in NumPy; it knows spheres only, and no occlusion."""
    from benchmarks.comparisons.planning.peers.paper_compiled import quadratic, sampled_value

    given = quadratic(problem)
    begin = perf_counter()
    path, note = paper_path(given)
    seconds = perf_counter() - begin
    return Attempt(sampled_value(problem, path) > 0.0, path, seconds, note)


class Peer(NamedTuple):
    """A method of `benchmarks.comparisons.planning.peers`."""

    name: str
    label: str
    module: str
    settings: dict[str, Any] | None = None
    """of `peers.local_search.Settings`; None: ``function`` is called as it is"""
    most: int | None = None
    budget: float = 5.0
    function: str = "solve"


_OFF = {"margin": 0.005}
_ANY = {"effort": False, "margin": 0.005}
_DENSE = {"samples": 100, "margin": 0.005}
_BEST = {"samples": 100, "all_starts": True}


def _descents(solver: str, label: str, most: int, budget: float) -> list[Peer]:
    """Return a descending solver's variants: any path, least effort, and least effort off the limits."""
    return [
        Peer(f"{solver}-first", f"{label}, any path, margin 0.005", solver, _ANY, most, budget),
        Peer(solver, f"{label}, least effort", solver, {}, most, budget),
        Peer(f"{solver}-margin", f"{label}, least effort, margin 0.005", solver, _OFF, most, budget),
    ]


_PEERS = (
    Peer("paper-compiled", "the paper's search, compiled", "paper_compiled"),
    Peer("slsqp", "SLSQP, 100 samples", "slsqp", {"samples": 100}, 200),
    Peer("slsqp-margin", "SLSQP, 100 samples, margin 0.005", "slsqp", _DENSE, 200),
    *_descents("snopt", "SNOPT, 25 samples", 200, 5.0),
    Peer(BEST_PEER, "SNOPT, 100 samples, best of 8 starts", "snopt", _BEST, 60),
    *_descents("ipopt", "IPOPT, 25 samples", 10, 10.0),
    Peer("rrtconnect", "RRTConnect, compiled checker", "rrtconnect", most=200),
    Peer("rrtconnect-numpy", "RRTConnect, Python checker", "rrtconnect", most=50, function="solve_numpy"),
)

NEEDS_SPHERES = frozenset({"paper-numpy", "paper-compiled"})
"""Methods that are not given sets with other obstacles."""


def ours() -> list[Method]:
    """Return ours: first path and least effort, kernel and public call."""
    return [
        Method("first", "ours, first path (kernel)", "Numba", partial(kernel, 0)),
        Method("effort", "ours, least effort (kernel)", "Numba", partial(kernel, 1)),
        Method("best", f"ours, best of {SEVERAL} starts (kernel)", "Numba", partial(kernel, SEVERAL)),
        Method("public-first", "ours, first path (`improving_plans`)", "Numba", partial(public, first_plan)),
        Method("public", "ours, least effort (`plan_path`)", "Numba", partial(public, plan_path)),
    ]


def all_methods() -> tuple[list[Method], dict[str, str]]:
    """Return every method whose library is there, and why the others are not: name → reason."""
    found: list[Method] = ours()
    missing: dict[str, str] = {}
    found.append(Method("paper-numpy", "the paper's search, NumPy", "NumPy", paper_numpy, 200))
    for peer in _PEERS:
        try:
            found.append(_loaded(peer))
        except ImportError as error:
            missing[peer.name] = str(error)
    return found, missing


def _loaded(peer: Peer) -> Method:
    """Return a peer's method.

    Raises:
        ImportError: its library is not there.
    """
    module = importlib.import_module(f"benchmarks.comparisons.planning.peers.{peer.module}")
    solve, callbacks = getattr(module, peer.function), module.CALLBACKS
    if peer.settings is not None:
        common = importlib.import_module("benchmarks.comparisons.planning.peers.local_search")
        solve = partial(solve, settings=common.Settings(**peer.settings))
    if peer.function != "solve":
        callbacks = getattr(module, peer.function.replace("solve", "CALLBACKS").upper())
    return Method(peer.name, peer.label, callbacks, solve, peer.most, peer.budget)
