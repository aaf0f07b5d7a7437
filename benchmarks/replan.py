"""Planning again while the arm moves: how long it takes, what jumps, and how often a way on is found.

Run: ``python -m benchmarks.replan [--count N] [--arms rx60,ur5e,panda] [--budget MS]``. Random tasks for a
whole arm (`tests.whole_arm.arm_scenes`) are planned and followed with a rest-to-rest law within half of the
arm's limits, at least 2 s; at a random moment one of the balls is put elsewhere, its middle within 5 cm of
the rest of the way, but so that neither the next 80 ms nor an end pose are taken. "Camera": without the arm;
"arm": joints and all links proven, too. "Solvable": replanned, or `plan_with_arm` (camera: `plan_path`) with
another seed finds a way for the very problem that replanning had, from the same pose and velocity. "In time":
within 33 ms, a period of the tasks' cameras. Times are the processor's for `Replanner.look`, of all changes
that were not kept, and of those for which another way was found. With a budget planning ends then. Warm, one
core.
"""

from __future__ import annotations

import argparse
from collections.abc import Iterator
from contextlib import suppress
from dataclasses import dataclass, replace
from itertools import pairwise
from time import process_time
from typing import Any

import numpy as np
from tests.whole_arm.arm_scenes import random_task

from omniservo.errors import Blocked
from omniservo.planning import Plan, PlanningProblem, plan_path
from omniservo.planning.obstacles.obstacle import Obstacle
from omniservo.replanning.frame_change import problem_from
from omniservo.robots import Arm, load_arm
from omniservo.servoing import PathLimits, RestToRestLaw
from omniservo.tracking import FollowingArm, PathTracker, Replanner, ReplanOptions
from omniservo.whole_arm import ArmSetting, plan_with_arm

AHEAD = 0.08
PERIOD = 1.0 / 30.0
SHARE = 0.5
LEAST_SECONDS = 2.0


@dataclass(frozen=True)
class Answer:
    """One change, answered."""

    outcome: str
    seconds: float
    twist_jump: float
    """[m/s, rad/s]"""
    joint_jump: float
    """[rad/s]"""
    solvable: bool
    """a full search from the same state finds a way"""


def planned(arm: Arm, random: np.random.Generator) -> Iterator[tuple[Any, ArmSetting]]:
    """Yield certified plans with an arm, and the setting."""
    while True:
        problem, setting = random_task(arm, random)
        found = plan_with_arm(problem, setting)
        if found.certified:
            yield found, setting


def moved(random: np.random.Generator, plan: Plan, w: float) -> tuple[Obstacle, ...]:
    """Return the plan's balls with one of them put near the rest of the way."""
    assert plan.path is not None
    balls = list(plan.problem.obstacles)
    i = int(random.integers(len(balls)))
    step = random.normal(size=3)
    step *= random.uniform(0, 0.05) / np.linalg.norm(step)
    place = plan.path(random.uniform(w, 1.0)).translation + step
    balls[i] = replace(balls[i], center=place)
    return tuple(balls)


def answered(
    plan: Plan,
    carried: FollowingArm | None,
    law: RestToRestLaw,
    time: float,
    balls: tuple[Obstacle, ...],
    budget: float | None,
) -> Answer | None:
    """Return what came of a change; None where the next 80 ms or an end pose are taken."""
    tracker = PathTracker(plan, plan.problem.camera, time_law=law)
    replanner = Replanner(tracker, plan, arm=carried, options=ReplanOptions(ahead=AHEAD, time_budget=budget))
    replanner.set_obstacles(balls)
    begin = process_time()
    with suppress(Blocked):
        replanner.look(time)
    seconds, event = process_time() - begin, replanner.events[-1]
    if any(words in event.reason for words in ("what is gone", "start pose", "goal pose")):
        return None
    twist, joint = 0.0, 0.0
    if event.leg is not None:
        for before, after in pairwise(tracker.legs):
            ends = [speed * leg.path(s, 1) for leg in (before, after) for s, speed in [leg.law(after.time)]]
            twist = max(twist, float(np.abs(ends[1] - ends[0]).max()))
            if carried is not None:
                slow, fast = (replanner.posture(after.time + d)[1] for d in (-1e-9, 0.0))
                joint = max(joint, float(np.abs(fast - slow).max()))
    solvable = event.outcome != "blocked" or _solvable(plan, carried, law(time + AHEAD)[0], event.problem)
    return Answer(event.outcome, seconds, twist, joint, solvable)


def _solvable(plan: Plan, carried: FollowingArm | None, w: float, problem: PlanningProblem) -> bool:
    """Return whether a full search from the same state finds a way."""
    assert plan.path is not None
    pose = plan.path(w)
    rest = problem_from(problem, pose, w, plan.path(w, 1))
    if carried is None:
        return plan_path(rest).status == "certified"
    setting = carried.setting
    here = replace(setting, base_T_initial=setting.base_T_initial * pose, start=carried.joints(w))
    return plan_with_arm(rest, here, seed=1).certified


def of_arm(name: str, count: int, budget: float | None, *, with_arm: bool) -> list[Answer]:
    """Return the answers to ``count`` changes on the way of an arm."""
    arm, random = load_arm(name), np.random.default_rng([6, len(name), count])

    def limits(path: Any, joints: Any) -> PathLimits:
        return PathLimits(joints, SHARE * arm.joint_speed, SHARE * arm.joint_acceleration)

    answers: list[Answer] = []
    for found, setting in planned(arm, random):
        law = RestToRestLaw.for_limits(limits(None, found.branch), least_duration=LEAST_SECONDS)
        carried = FollowingArm(setting, found.branch, limits) if with_arm else None
        time = random.uniform(0.1, 0.6) * law.duration
        balls = moved(random, found.plan, law(time + AHEAD)[0])
        answer = answered(found.plan, carried, law, time, balls, budget)
        answers += [] if answer is None else [answer]
        if len(answers) == count:
            break
    return answers


def row(name: str, answers: list[Answer]) -> str:
    """Return a line of the table."""
    again = [a for a in answers if a.outcome != "kept"]
    found = [a for a in again if a.outcome == "replanned"]
    in_time, solvable = sum(a.seconds <= PERIOD for a in found), sum(a.solvable for a in again)
    jumps = max(a.twist_jump for a in answers), max(a.joint_jump for a in answers)
    return (
        f"| {name} | {len(answers)} | {len(answers) - len(again)} | {len(found)} | {in_time} | {solvable} "
        f"| {_times(again)} | {_times(found)} | {jumps[0]:.0e} | {jumps[1]:.0e} |"
    )


def _times(answers: list[Answer]) -> str:
    if not answers:
        return "–"
    values = np.percentile([1e3 * a.seconds for a in answers], [50, 90, 100])
    return " / ".join(f"{value:.1f}" for value in values)


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser()
    parser.add_argument("--count", type=int, default=100, help="changes on the way of each arm")
    parser.add_argument("--arms", default="rx60,ur5e,panda")
    parser.add_argument("--budget", type=float, default=None, help="planning ends then [ms]; none: never")
    given = parser.parse_args()
    budget = None if given.budget is None else 1e-3 * given.budget
    head = (
        "",
        "changes",
        "kept",
        "replanned",
        "in time",
        "solvable",
        "ms, median / 90% / worst",
        "of the replanned",
        "twist",
        "joints",
    )
    print(f"| {' | '.join(head)} |")
    print("|" + "---|" * len(head))
    for name in given.arms.split(","):
        for with_arm in (False, True):
            label = f"{name}, {'arm' if with_arm else 'camera'}"
            print(row(label, of_arm(name, given.count, budget, with_arm=with_arm)), flush=True)


if __name__ == "__main__":
    main()
