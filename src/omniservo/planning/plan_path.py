"""From a problem to a plan."""

from __future__ import annotations

import time
from typing import Literal

from omniservo.errors import InputError
from omniservo.geometry.arrays import finite_number
from omniservo.planning.end_poses import violation_at_end
from omniservo.planning.improving_plans import (
    Quality,
    checked_quality,
    first_proven,
    improving_plans,
    looked,
)
from omniservo.planning.judged_plan import infeasible_plan, judged_plan
from omniservo.planning.paper_search import paper_path
from omniservo.planning.plan import Plan
from omniservo.planning.planning_problem import PlanningProblem
from omniservo.planning.search.problem_search import ProblemSearch
from omniservo.planning.time_budget import TimeBudget

Method = Literal["certified", "paper"]


def plan_path(
    problem: PlanningProblem,
    *,
    method: Method = "certified",
    quality: Quality = "effort",
    time_budget: float | None = None,
    seed: int = 0,
) -> Plan:
    """Return a plan; without a time budget the same problem, method, quality and seed give the same path.

    Args:
        problem: what to plan.
        method: "certified": a path that is proven for all w. "paper": (36)–(38) on samples, judged by the
            same certificate.
        quality: "effort": of least bending energy. "margin": of the largest smallest margin, and of least
            bending energy at that; see `improving_plans`.
        time_budget: [s]: the best plan that so much time gives; see `improving_plans`. None: near the first
            path that is found for "effort", all there is for "margin".
        seed: turns the directions in which detours are tried.

    Raises:
        InputError: an argument that is not legal, a method that cannot take an obstacle, or the visibility
            margin leaves nothing of the image.
    """
    if method not in ("certified", "paper"):
        raise InputError(f"method: {method!r} given; legal: 'certified', 'paper'")
    checked_quality(quality)
    if method == "paper":
        if quality != "effort" or time_budget is not None:
            raise InputError('method: "paper" given; it knows neither quality nor time_budget')
        return _paper_plan(problem)
    if quality == "margin" or time_budget is not None:
        *_, plan = improving_plans(problem, quality=quality, time_budget=time_budget, seed=seed)
        return plan
    finite_number("seed", seed, minimum=0)
    begin = time.perf_counter()
    reason = violation_at_end(problem)
    if reason:
        return infeasible_plan(problem, begin, method, reason)
    budget = TimeBudget(None)
    found, tried = first_proven(ProblemSearch.of(problem, int(seed)), budget, 1)
    return judged_plan(problem, found.path, begin, method, "", looked(tried, budget))


def _paper_plan(problem: PlanningProblem) -> Plan:
    begin = time.perf_counter()
    reason = violation_at_end(problem)
    if reason:
        return infeasible_plan(problem, begin, "paper", reason)
    path, note = paper_path(problem)
    return judged_plan(problem, path, begin, "paper", note)
