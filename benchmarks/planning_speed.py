"""Time of planning: shipped tasks with dots for a target, had their estimate no error, and larger ones.

Run: ``python -m benchmarks.planning_speed``. "Kernel": arrays in, coefficients and verdict out, first proven
path. "Economised": the same, then least effort, proven again. "Public": `plan_path`, a problem in, a plan
with every margin out. "Paper": the paper's own search in NumPy. Warm; medians of many calls.
Planning again on the way has its own, `benchmarks.replanning_speed`.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace
from functools import partial
from time import perf_counter

import numpy as np

from omniservo.errors import InputError
from omniservo.planning import Cloud, PlanningProblem, Sphere, plan_path
from omniservo.planning.obstacles.ball_tree import ball_tree
from omniservo.planning.paper_search import paper_path
from omniservo.planning.search.problem_search import ProblemSearch
from omniservo.runs.plan_task import problem_of
from omniservo.tasks import load_task, shipped_tasks


def shipped_problem(name: str) -> PlanningProblem:
    """Return the planning problem of a shipped task, had its estimate no error."""
    task = load_task(name)
    points = np.array([dot.center for dot in task.target.dots])
    return problem_of(task, task.teach.initial_T_goal.transform, points)


def many_targets(count: int) -> PlanningProblem:
    """Return the paper's example 1 with ``count`` target points, spread where its dots are."""
    problem = shipped_problem("paper-example-1")
    low, high = problem.points.min(axis=0), problem.points.max(axis=0)
    points = np.random.default_rng(count).uniform(low, high, (count, 3))
    return replace(problem, points=points)


def beside_a_board(count: int) -> PlanningProblem:
    """Return the paper's example 1 with a scan beside the path: ``count`` points of radius 2 mm."""
    problem = shipped_problem("paper-example-1")
    rng = np.random.default_rng(count)
    scan = np.column_stack([rng.normal(0.12, 0.002, count), rng.uniform(-0.4, 0.2, (count, 2))])
    return replace(problem, obstacles=(*problem.obstacles, Cloud(scan, 0.002)))


def among_spheres(count: int) -> PlanningProblem:
    """Return the same with a sphere for each point."""
    problem = beside_a_board(count)
    cloud = problem.obstacles[-1]
    assert isinstance(cloud, Cloud)
    return replace(problem, obstacles=(*problem.obstacles[:-1], *(Sphere(p, 0.002) for p in cloud.points)))


def kernel_microseconds(name: str, *, economised: int = 0, calls: int = 500) -> float:
    """Return the median time of the compiled search [µs], on a shipped task; ``economised``: see `search`."""
    return search_microseconds(shipped_problem(name), economised, calls)


def search_microseconds(problem: PlanningProblem, economised: int, calls: int) -> float:
    """Return the median time of the compiled search [µs]."""
    search = ProblemSearch.of(problem)
    return 1e6 * median_seconds(partial(search.kernel, 0, search.starts, economised), calls)


def public_microseconds(name: str, calls: int = 200) -> float:
    """Return the median time of `plan_path` [µs], on a shipped task."""
    problem = shipped_problem(name)
    assert plan_path(problem).status == "certified"
    return 1e6 * median_seconds(partial(plan_path, problem), calls)


def paper_microseconds(name: str, calls: int = 20) -> float:
    """Return the median time of the paper's search in NumPy [µs], on a shipped task."""
    try:
        return 1e6 * median_seconds(partial(paper_path, shipped_problem(name)), calls)
    except InputError:  # it knows spheres alone
        return math.nan


def median_seconds(call: Callable[[], object], calls: int) -> float:
    """Return the median time of ``call`` after one call that is not counted [s]."""
    call()
    taken = []
    for _ in range(calls):
        before = perf_counter()
        call()
        taken.append(perf_counter() - before)
    return float(np.median(taken))


if __name__ == "__main__":
    print(f"{'task':<20} {'kernel':>10} {'economised':>11} {'public':>10} {'paper':>10}  [µs]")
    for name in (name for name in shipped_tasks() if load_task(name).target.dots):
        times = (
            kernel_microseconds(name),
            kernel_microseconds(name, economised=1),
            public_microseconds(name),
            paper_microseconds(name),
        )
        print(f"{name:<20} {times[0]:>10.1f} {times[1]:>11.1f} {times[2]:>10.1f} {times[3]:>10.1f}")
    larger = {f"{n} target points": many_targets(n) for n in (9, 50, 200, 1000)}
    larger |= {f"cloud of {n}": beside_a_board(n) for n in (10_000, 100_000)}
    larger |= {f"{n} spheres": among_spheres(n) for n in (1000,)}
    for name, problem in larger.items():
        plan = plan_path(problem)
        kernel, economised = (search_microseconds(problem, e, 100) for e in (0, 1))
        public = 1e6 * median_seconds(partial(plan_path, problem), 20)
        print(f"{name:<20} {kernel:>10.1f} {economised:>11.1f} {public:>10.1f} {plan.status:>10}")
    scan = np.array(larger["cloud of 10000"].obstacles[-1].points)
    print(f"tree of 10 000 points, once a cloud: {1e6 * median_seconds(partial(ball_tree, scan), 20):.0f} µs")
