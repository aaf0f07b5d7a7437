"""From what a job's first image shows to its plan, each stage timed."""

from __future__ import annotations

from collections.abc import Callable
from time import perf_counter
from typing import TypeVar

from omniservo.geometry.arrays import ByteArray, FloatArray
from omniservo.geometry.compiler_watch import CompilerWatch
from omniservo.perception import FeatureKind
from omniservo.planning import Plan
from omniservo.risk import RiskPlan
from omniservo.run_methods import RunMethod
from omniservo.runs.estimate_task import estimate_task
from omniservo.runs.followed_of import followed_of
from omniservo.runs.joined_views import Job
from omniservo.runs.look_again import LookingPlanner
from omniservo.runs.pace import pace
from omniservo.runs.plan_task import plan_task
from omniservo.runs.see import see
from omniservo.scenes import Scene
from omniservo.tasks import Task, TaughtGoal
from omniservo.tracking.planned_motion import PlannedMotion

T = TypeVar("T")


def first_job(
    task: Task,
    scene: Scene,
    kind: FeatureKind,
    image: ByteArray,
    goal: TaughtGoal,
    joints: FloatArray,
    seconds: dict[str, float],
) -> Job:
    """Return the job as the first image (height, width), taken in ``joints`` (n,) [rad], has it.

    ``seconds`` takes how long perception and estimation took.

    Raises:
        InputError, NoSolutionError: as `run_task`.
    """
    seen = timed("perception", seconds, lambda: see(kind, task.camera, image, goal.image))
    estimate = timed("estimation", seconds, lambda: estimate_task(task, scene, seen, goal, joints))
    followed = followed_of(task, estimate, seen.matched.initial)
    return Job(task, scene, seen, estimate, followed)


def planned_job(
    planner: LookingPlanner, method: RunMethod, seed: int, seconds: dict[str, float]
) -> tuple[Plan | None, RiskPlan | None, PlannedMotion | None]:
    """Return plan, risk and motion; nothing where the method plans nothing. "paper" never looks again."""
    if method.plans is None:
        return None, None, None
    if method.plans == "paper":
        job = planner.job
        plan, risk = timed(
            "planning",
            seconds,
            lambda: plan_task(job.task, job.scene, job.estimate, job.followed, "paper", seed),
        )
    else:
        plan, risk = timed("planning", seconds, planner.plan)
        if planner.looks:
            seconds["planning"] -= planner.seconds
            seconds["looking_again"] = planner.seconds
    motion = pace(planner.job.task, planner.job.scene, plan)
    return plan, risk, motion


def timed(stage: str, seconds: dict[str, float], work: Callable[[], T]) -> T:
    """Return what the work gives; note how long it took, and what of that was loading or compiling code."""
    before = perf_counter()
    with CompilerWatch() as watch:
        value = work()
    seconds[stage], seconds[f"{stage}_code"] = perf_counter() - before, watch.seconds
    return value
