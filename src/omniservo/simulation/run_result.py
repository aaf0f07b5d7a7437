"""Everything that one run produced: what the report is made from."""

from __future__ import annotations

from dataclasses import dataclass, field

from omniservo.estimation import TwoViewEstimate
from omniservo.geometry.arrays import ByteArray, FloatArray
from omniservo.planning import Plan
from omniservo.simulation.run_log import RunLog
from omniservo.tasks.task import Task
from omniservo.tasks.taught_goal import TaughtGoal


@dataclass(frozen=True)
class Seen:
    """The two pictures and the dots matched between them."""

    initial_image: ByteArray
    """(height, width)"""
    initial_dots: FloatArray
    """(n, 2) [px], in the order of the initial picture: top to bottom, then left to right"""
    goal_dots: FloatArray
    """(n, 2) [px], row j belongs to row j of initial_dots"""
    residual_px: float
    """of the match"""


@dataclass(frozen=True)
class Film:
    """Pictures taken during the servo, for the animation."""

    times: tuple[float, ...]
    """[s]"""
    camera: tuple[ByteArray, ...]
    """(height, width) each, what the camera saw"""
    outside: tuple[ByteArray, ...]
    """(rows, columns, 3) each, a bystander's view"""


@dataclass(frozen=True)
class Truth:
    """The simulator's truth, for scoring and for the report's figures only."""

    initial_T_goal: FloatArray
    """(4, 4)"""
    points: FloatArray
    """(n, 3) the matched dots' centres, initial camera frame [m]"""
    obstacle_corners: tuple[FloatArray, ...]
    """(8, 3) of each obstacle block, initial camera frame [m]"""


@dataclass(frozen=True)
class RunResult:
    """One run of one method on one task."""

    task: Task
    method: str
    """"certified", "paper" or "ibvs\""""
    goal: TaughtGoal
    seen: Seen
    estimate: TwoViewEstimate
    plan: Plan | None
    """None for "ibvs", which plans nothing"""
    log: RunLog
    final_image: ByteArray
    outside_initial: ByteArray
    """(rows, columns, 3) robot and obstacle at the start"""
    outside_final: ByteArray
    film: Film
    truth: Truth
    seconds: dict[str, float]
    """perception, estimation, planning (each once), control (median of a step), whole run"""
    metrics: dict[str, object] = field(default_factory=dict)
    """as in metrics.json"""
