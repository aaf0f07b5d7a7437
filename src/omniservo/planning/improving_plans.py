"""Plans that get better while there is time: the first that is certified, then only better ones."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any, Literal

from omniservo.errors import InputError
from omniservo.geometry.arrays import finite_number
from omniservo.planning.end_poses import violation_at_end
from omniservo.planning.judged_plan import infeasible_plan, judged_plan
from omniservo.planning.more_margin import TINY, paths_of_more_margin, smallest_margin
from omniservo.planning.plan import Plan
from omniservo.planning.planning_problem import PlanningProblem
from omniservo.planning.search.problem_search import Found, ProblemSearch
from omniservo.planning.time_budget import TimeBudget

NOTABLY = 0.999
"""A better path has at most this part of the energy of the one before."""

_TOGETHER = 8
"""starts in one call of the kernel, which no signal interrupts"""

Quality = Literal["effort", "margin"]
"""effort: bending energy. margin: the smallest margin; where the end poses themselves leave little of a
constraint, it is kept at that and does not hold the others back."""


def improving_plans(
    problem: PlanningProblem, *, quality: Quality = "effort", time_budget: float | None = None, seed: int = 0
) -> Iterator[Plan]:
    """Yield the first certified plan, then better ones, each certified, until starts or time are used up.

    If there is none, the one plan that is yielded says why. Without a time budget, or where it is not used
    up, the same problem and seed give the same plans.

    Args:
        problem: what to plan.
        quality: what is better; see `Quality`.
        time_budget: [s] from this call on, checked between starts, or for more margin between groups of
            13. A start takes about 0.2 ms with 9 points, 4 ms with 1000, 1 s with 1e5. One is always made.
            None: without end.
        seed: turns the directions in which detours are tried.

    Raises:
        InputError: an argument that is not legal, or the visibility margin leaves nothing of the image.
    """
    budget = TimeBudget(time_budget)
    checked_quality(quality)
    finite_number("seed", seed, minimum=0)
    return _improving(problem, quality, budget, int(seed))


def checked_quality(quality: Any) -> None:
    """Raise for a quality that there is not.

    Raises:
        InputError: not one of `Quality`.
    """
    if quality not in ("effort", "margin"):
        raise InputError(f"quality: {quality!r} given; legal: 'effort', 'margin'")


def _improving(problem: PlanningProblem, quality: str, budget: TimeBudget, seed: int) -> Iterator[Plan]:
    reason = violation_at_end(problem)
    if reason:
        yield infeasible_plan(problem, budget.begin, "certified", reason)
        return
    search = ProblemSearch.of(problem, seed)
    found, tried = first_proven(search, budget)
    plan = judged_plan(problem, found.path, budget.begin, "certified", "", looked(tried, budget))
    yield plan
    if plan.status != "certified":
        return
    if quality == "effort":
        for better in paths_of_less_effort(search, found, tried, budget):
            candidate = judged_plan(problem, better.path, budget.begin, "certified", "")
            if candidate.status == "certified":
                yield candidate
    else:
        yield from _plans_of_more_margin(search, found, plan, budget, seed)


def _plans_of_more_margin(
    search: ProblemSearch, found: Found, plan: Plan, budget: TimeBudget, seed: int
) -> Iterator[Plan]:
    """Yield certified plans of more and more margin, and never a smaller smallest one."""
    least = smallest_margin(plan)
    thrifty = search.run(found.number, found.number + 1, 1)
    candidate = judged_plan(plan.problem, thrifty.path, budget.begin, "certified", "")
    if candidate.status == "certified" and smallest_margin(candidate) > least:
        plan, least = candidate, smallest_margin(candidate)
        yield plan
    for path in paths_of_more_margin(plan, budget, seed):
        candidate = judged_plan(plan.problem, path, budget.begin, "certified", "")
        if candidate.status == "certified" and smallest_margin(candidate) >= least - 2.0 * TINY:
            least = max(least, smallest_margin(candidate))
            yield candidate


def first_proven(
    search: ProblemSearch, budget: TimeBudget, economised: int = 0, begin: int = 0
) -> tuple[Found, int]:
    """Return the first proven path, else the best attempt, and how many starts were tried.

    A few starts are one call, between which Ctrl-C is answered; with a bounded budget, which is checked
    between them, every start is. Starts are tried, and counted, from ``begin`` on.
    """
    together = 1 if budget.is_bounded else _TOGETHER
    end = min(begin + together, search.starts)
    best = last = search.run(begin, end, economised)
    while not best.proven and last.tried == end < search.starts and not budget.is_used_up:
        begin, end = end, min(end + together, search.starts)
        last = search.run(begin, end, economised)
        if last.proven or last.worst >= best.worst:
            best = last
    return best, last.tried


def looked(tried: int, budget: TimeBudget) -> str:
    """Return how far was looked, for a path that was not found."""
    if budget.is_used_up:
        return f"no path was found: time budget of {budget.seconds:g} s used up after {tried} starts"
    return f"no path was found in {tried} starts"


def paths_of_less_effort(
    search: ProblemSearch, first: Found, tried: int, budget: TimeBudget
) -> Iterator[Found]:
    """Yield proven paths of less and less energy: near the first one, then near those of further starts."""
    best = first.energy
    for number in (first.number, *range(tried, search.starts)):
        if budget.is_used_up or best <= first.least_energy:
            return
        found = search.run(number, number + 1, 1, best)
        if found.proven and found.energy < NOTABLY * best:
            best = found.energy
            yield found
