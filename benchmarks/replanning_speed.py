"""Time of replanning on the way: an obstacle has moved by 10 to 30 mm, or the goal by 10 mm.

Run: ``python -m benchmarks.replanning_speed [--count N]``. Plans of the published sets
(`benchmarks.comparisons.planning.sets`) are followed to a random w; from the pose and velocity there the rest
is planned again. "Kernel": `settle_rest`, arrays in, coefficients and verdict out, whether it finds a path or
not; "blocked": the same where the rest of the old path is no longer of use. "Public": `replan`, a plan in, a
plan with every margin out, search included. Warm, one core; medians of 15 calls a problem.
"""

from __future__ import annotations

import argparse
from collections.abc import Iterator
from dataclasses import dataclass, replace
from functools import partial

import numpy as np
from benchmarks.comparisons.planning.sets import problems
from benchmarks.planning_speed import median_seconds
from scipy.spatial.transform import RigidTransform

from omniservo.geometry.subdivision import PROVEN
from omniservo.planning import Plan, PlanningProblem, Sphere, plan_path
from omniservo.planning.end_poses import violation_at_end
from omniservo.planning.search.problem_search import ProblemSearch
from omniservo.replanning import replan
from omniservo.replanning.frame_change import problem_from
from omniservo.replanning.replan import rest_arguments
from omniservo.replanning.rest_of_path import settle_rest

SETS = ("fisheye", "perspective", "catadioptric", "occlusion")
CALLS = 15


@dataclass
class Replanned:
    """One change on one plan."""

    in_the_way: bool
    """the rest of the old path is no longer certified"""
    warm: bool
    """the warm start found a path"""
    found: bool
    """`replan` found one"""
    kernel: float
    """[µs]"""
    public: float
    """[µs]"""


def random_step(rng: np.random.Generator, size: float) -> np.ndarray:
    """Return a vector (3,) of this length [m]."""
    step = rng.normal(size=3)
    return size * step / np.linalg.norm(step)


def obstacle_moved(rng: np.random.Generator, problem: PlanningProblem) -> PlanningProblem:
    """Return the problem with one sphere 10 to 30 mm away."""
    i = int(rng.integers(len(problem.obstacles)))
    sphere = problem.obstacles[i]
    assert isinstance(sphere, Sphere)
    other = replace(sphere, center=sphere.center + random_step(rng, rng.uniform(0.010, 0.030)))
    return replace(problem, obstacles=(*problem.obstacles[:i], other, *problem.obstacles[i + 1 :]))


def goal_moved(rng: np.random.Generator, problem: PlanningProblem) -> PlanningProblem:
    """Return the problem with the goal 10 mm away."""
    goal = problem.initial_T_goal
    moved = RigidTransform.from_components(goal.translation + random_step(rng, 0.010), goal.rotation)
    return replace(problem, initial_T_goal=moved)


CHANGES = {"obstacle 10-30 mm": obstacle_moved, "goal 10 mm": goal_moved}


def replanned(plan: Plan, w: float, changed: PlanningProblem) -> Replanned | None:
    """Return what replanning came to; None where the change leaves no path at an end pose."""
    assert plan.path is not None
    pose, twist = plan.path(w), plan.path(w, 1)
    rest = problem_from(changed, pose, w, twist)
    if violation_at_end(rest):
        return None
    search = ProblemSearch.of(rest)
    arguments = rest_arguments(search, plan.path, w, pose)
    warm = settle_rest(*arguments)[0] == PROVEN
    new = replan(plan, w, changed)
    assert new.path is not None
    s = np.linspace(0.0, 1.0, 11)
    same = np.abs((pose * new.path(s)).as_matrix() - plan.path(w + (1.0 - w) * s).as_matrix()).max() < 1e-9
    return Replanned(
        not same,
        warm,
        new.status == "certified",
        1e6 * median_seconds(partial(settle_rest, *arguments), CALLS),
        1e6 * median_seconds(partial(replan, plan, w, changed), CALLS),
    )


def of_set(name: str, change: str, count: int) -> Iterator[Replanned | None]:
    """Yield what replanning came to on the plans of a set, one random w and change each."""
    rng = np.random.default_rng([20261121, list(CHANGES).index(change), SETS.index(name)])
    for problem in problems(name, count):
        plan = plan_path(problem)
        if plan.status == "certified":
            yield replanned(plan, rng.uniform(0.1, 0.8), CHANGES[change](rng, problem))


def kernel_microseconds(count: int = 25) -> float:
    """Return the median over problems, ``count`` of each set with each change, of the kernel's time [µs]."""
    results = [r for name in SETS for change in CHANGES for r in of_set(name, change, count)]
    return float(np.median([r.kernel for r in results if r is not None]))


def row(name: str, change: str, results: list[Replanned | None]) -> str:
    """Return a line of the table."""
    found = [r for r in results if r is not None]
    blocked = [r for r in found if r.in_the_way]
    kernel = np.array([r.kernel for r in found])
    hard = np.median([r.kernel for r in blocked]) if blocked else np.nan
    public = np.median([r.public for r in found])
    return (
        f"{name:<14} {change:<18} {len(found):>5} {len(blocked):>6} {sum(r.warm for r in found):>5}"
        f" {sum(r.found for r in found):>6} {np.median(kernel):>8.1f} {np.percentile(kernel, 95):>8.1f}"
        f" {hard:>8.1f} {public:>8.0f}"
    )


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser()
    parser.add_argument("--count", type=int, default=100, help="problems of each set")
    count = parser.parse_args().count
    head = ("plans", "in way", "warm", "found", "kernel", "p95", "blocked", "public")
    print(
        f"{'set':<14} {'change':<18} " + "{:>5} {:>6} {:>5} {:>6} {:>8} {:>8} {:>8} {:>8}  [µs]".format(*head)
    )
    for name in SETS:
        for change in CHANGES:
            print(row(name, change, list(of_set(name, change, count))))


if __name__ == "__main__":
    main()
