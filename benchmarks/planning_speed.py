"""Time of planning the shipped tasks, from their true motion and structure.

Run: ``python -m benchmarks.planning_speed``. "Kernel": arrays in, coefficients and verdict out, first proven
path. "Economised": the same, then least effort, proven again. "Public": `plan_path`, a problem in, a plan
with every margin out. "Paper": the paper's own search in NumPy. Warm; medians of many calls.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from time import perf_counter

import numpy as np
from scipy.spatial.transform import RigidTransform

from omniservo.geometry.arrays import FloatArray
from omniservo.planning import PlanningProblem, plan_path
from omniservo.planning.paper_search import paper_path
from omniservo.planning.problem_search import ProblemSearch
from omniservo.runs.plan_task import problem_of
from omniservo.tasks import load_task, shipped_tasks


@dataclass
class Truth:
    """What an estimate without error says."""

    initial_T_goal: RigidTransform
    points: FloatArray


def shipped_problem(name: str) -> PlanningProblem:
    """Return the planning problem of a shipped task, had its estimate no error."""
    task = load_task(name)
    points = np.array([dot.center for dot in task.target.dots])
    return problem_of(task, Truth(task.teach.initial_T_goal.transform, points))


def kernel_microseconds(name: str, *, economised: int = 0, calls: int = 500) -> float:
    """Return the median time of the compiled search [µs], on a shipped task; ``economised``: see `search`."""
    search = ProblemSearch.of(shipped_problem(name))
    return 1e6 * median_seconds(partial(search.kernel, 0, search.starts, economised), calls)


def public_microseconds(name: str, calls: int = 200) -> float:
    """Return the median time of `plan_path` [µs], on a shipped task."""
    problem = shipped_problem(name)
    assert plan_path(problem).status == "certified"
    return 1e6 * median_seconds(partial(plan_path, problem), calls)


def paper_microseconds(name: str, calls: int = 20) -> float:
    """Return the median time of the paper's search in NumPy [µs], on a shipped task."""
    return 1e6 * median_seconds(partial(paper_path, shipped_problem(name)), calls)


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
    for task in shipped_tasks():
        name = getattr(task, "name", task)
        times = (
            kernel_microseconds(name),
            kernel_microseconds(name, economised=1),
            public_microseconds(name),
            paper_microseconds(name),
        )
        print(f"{name:<20} {times[0]:>10.1f} {times[1]:>11.1f} {times[2]:>10.1f} {times[3]:>10.1f}")
