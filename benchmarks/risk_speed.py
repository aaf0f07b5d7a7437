"""Time of planning at a stated risk: a shipped task, and whole arms among balls.

Run: ``python -m benchmarks.risk_speed [--tasks 10] [--arm NAME]``. `textured-object` is planned for as by
`omniservo run`, its estimate from one look. The arms' tasks are those of `benchmarks.arm_loops`, from the
first seed on, that have a plan where everything is known, and an estimate. "Rounds" are plans of the whole
arm that were searched for, "samples" how many were executed, those that show where to check included,
"sampling", "executing", "gaps" and "planning" where the time went [ms], of one processor, without what it
waits for others. Warm: the first answer is not counted; the shorter of two.
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Callable, Iterator
from contextlib import closing, contextmanager
from dataclasses import dataclass, field, replace
from functools import partial
from time import process_time
from typing import Any

import numpy as np
from benchmarks.arm_loops import (
    LEAST_DISTANCE,
    SEED,
    TARGET,
    Truth,
    known_of,
    planned,
    projected,
    random_task,
)

from omniservo.errors import InputError
from omniservo.estimation import TwoViewEstimate
from omniservo.looks.followed_points import followed_points
from omniservo.risk import Executions, RiskPlan
from omniservo.robots import load_arm, next_image, shipped_arms, shipped_tube
from omniservo.runs.estimate_task import estimate_task
from omniservo.runs.feature_kind_of import feature_kind_of
from omniservo.runs.plan_task import plan_task
from omniservo.runs.see import see
from omniservo.runs.teach_goal import teach_goal
from omniservo.simulation import SimulatedCell
from omniservo.tasks import load_task
from omniservo.whole_arm import plan_with_arm

PARTS: dict[str, tuple[Any, str]] = {
    "planning": (sys.modules["omniservo.risk.link_margin"], "plan_with_arm"),
    "gaps": (sys.modules["omniservo.risk.link_margin"], "taken_by"),
    "executing": (Executions, "_run"),
    "sampling": (TwoViewEstimate, "sample"),
}
"""what is timed"""


@dataclass
class Spent:
    """What one answer took."""

    seconds: float = 0.0
    rounds: int = 0
    executed: int = 0
    parts: dict[str, float] = field(default_factory=lambda: dict.fromkeys(PARTS, 0.0))


@contextmanager
def watched(spent: Spent) -> Iterator[None]:
    """Time the parts of what is done inside."""

    def timed(name: str, call: Callable[..., Any]) -> Callable[..., Any]:
        def wrapped(*given: Any, **options: Any) -> Any:
            before = process_time()
            try:
                return call(*given, **options)
            finally:
                spent.parts[name] += process_time() - before
                spent.rounds += name == "planning"
                spent.executed += len(given[3]) if name == "executing" else 0

        return wrapped

    kept = {name: getattr(*of) for name, of in PARTS.items()}
    for name, of in PARTS.items():
        setattr(*of, timed(name, kept[name]))
    try:
        yield
    finally:
        for name, of in PARTS.items():
            setattr(*of, kept[name])


def spent_on(answer: Callable[[], RiskPlan]) -> tuple[RiskPlan, Spent]:
    """Return an answer, and what the shorter of two calls took."""
    answer()
    calls = []
    for _ in range(2):
        spent, before = Spent(), process_time()
        with watched(spent):
            found = answer()
        spent.seconds = process_time() - before
        calls.append(spent)
    return found, min(calls, key=lambda spent: spent.seconds)


def shipped(name: str) -> Callable[[], RiskPlan]:
    """Return what plans a shipped task at its risk."""
    task, kind = load_task(name), feature_kind_of(load_task(name))
    with closing(SimulatedCell(task, 1)) as cell:
        goal = teach_goal(task, cell)
    with closing(SimulatedCell(task, 0)) as cell:
        image, joints = next_image(cell.camera, cell.wait), cell.driver.read().joint_positions
        seen = see(kind, task.camera, image.pixels, goal.image)
        scene = cell.scene
        estimate = estimate_task(task, scene, seen, goal, joints)
        followed = followed_points(estimate, seen.matched.initial)

    def answer() -> RiskPlan:
        risk = plan_task(task, scene, estimate, followed, "certified", 0)[1]
        if risk is None:
            raise ValueError(f"{name}: no risk is stated")
        return risk

    return answer


def arm_tasks(name: str) -> Iterator[tuple[int, Callable[[], RiskPlan]]]:
    """Yield seeds, and what plans their task at a risk of 1%."""
    arm, tube, seed = load_arm(name), shipped_tube(name), 0
    while True:
        seed += 1
        random = np.random.default_rng([SEED, seed])
        problem, setting = random_task(arm, random, **TARGET)
        problem = replace(problem, least_distance=LEAST_DISTANCE)
        if setting.start is None or not plan_with_arm(problem, setting).certified:
            continue
        balls = [(np.array(o.center), o.radius) for o in problem.obstacles]
        truth = Truth(arm, setting.start, setting.flange_T_camera, problem.camera, problem.points, balls)
        try:
            known = known_of(truth, problem, random, projected(truth, problem, random))
            if known.estimate.status == "ok":
                answered(truth, problem, setting, known, tube, seed)
                yield seed, partial(answered, truth, problem, setting, known, tube, seed)
        except InputError:  # a pixel outside the domain, or a start that keeps too little of its ranges
            continue


def answered(*given: Any) -> RiskPlan:
    """Return the plan at the stated risk, or why there is none."""
    return planned(*given)[0]


def row(name: str, found: RiskPlan, spent: Spent) -> str:
    """Return a row of the table."""
    parts = " | ".join(
        f"{1e3 * spent.parts[part]:.0f}" for part in ("sampling", "executing", "gaps", "planning")
    )
    return (
        f"| {name} | {'yes' if found.ok else 'no'} | {spent.rounds} | {spent.executed} | {parts} |"
        f" {1e3 * spent.seconds:.0f} |"
    )


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser()
    parser.add_argument("--tasks", type=int, default=10, help="of every arm")
    parser.add_argument("--arm", choices=shipped_arms(), action="append")
    asked = parser.parse_args()
    print("| task | plan | rounds | samples | sampling | executing | gaps | planning | all [ms] |")
    print("|---|---|---|---|---|---|---|---|---|")
    print(row("textured-object", *spent_on(shipped("textured-object"))), flush=True)
    everything: list[tuple[bool, float]] = []
    for name in asked.arm or shipped_arms():
        tasks = arm_tasks(name)
        for seed, answer in (next(tasks) for _ in range(asked.tasks)):
            found, spent = spent_on(answer)
            everything.append((found.ok, spent.seconds))
            print(row(f"{name} {seed}", found, spent), flush=True)
    for said, of in (("all", (True, False)), ("with a plan", (True,)), ("without", (False,))):
        seconds = [s for ok, s in everything if ok in of]
        if seconds:
            middle, most = 1e3 * np.median(seconds), 1e3 * max(seconds)
            print(f"arms, {said}: {len(seconds)} tasks, median {middle:.0f} ms, longest {most:.0f} ms")


if __name__ == "__main__":
    main()
