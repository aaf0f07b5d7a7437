"""The two experiments of the paper as whole runs, and the time from images to a plan.

`stage_times` is warm: each stage is called before the clock starts. A run's own times are those of its only
computation, which in a process's first run loads code.
"""

from __future__ import annotations

from dataclasses import dataclass
from time import perf_counter

import numpy as np

from omniservo.estimation import estimate_two_view
from omniservo.planning import plan_path
from omniservo.results.run_result import RunResult
from omniservo.runs import run_task, see
from omniservo.runs.feature_kind_of import feature_kind_of
from omniservo.simulation import SimulatedCell
from omniservo.tasks import load_task


@dataclass(frozen=True)
class StageTimes:
    """Median times of one task's stages [s]."""

    perception: float
    """detection in both images and matching"""
    estimation: float
    planning: float
    """the public call, margins included"""

    @property
    def from_points(self) -> float:
        """Motion, structure and planning [s]."""
        return self.estimation + self.planning

    @property
    def from_images(self) -> float:
        """The same with detection and matching [s]."""
        return self.perception + self.from_points


def whole_run(name: str, method: str = "certified") -> RunResult:
    """Return one run of a shipped task."""
    return run_task(load_task(name), SimulatedCell, method=method)


def stage_times(result: RunResult, rounds: int = 15) -> StageTimes:
    """Time the stages again on the images of a run."""
    task, seen = result.task, result.seen
    kind = feature_kind_of(task)

    def estimate() -> object:
        scale = task.scale.displacement
        return estimate_two_view(task.camera, seen.matched.initial, seen.matched.goal, scale=scale)

    assert result.plan is not None
    problem = result.plan.problem
    return StageTimes(
        _median(lambda: see(kind, task.camera, seen.initial_image, result.goal.image), rounds),
        _median(estimate, rounds),
        _median(lambda: plan_path(problem), rounds),
    )


def _median(call: object, rounds: int) -> float:
    assert callable(call)
    call()
    taken = []
    for _ in range(rounds):
        before = perf_counter()
        call()
        taken.append(perf_counter() - before)
    return float(np.median(taken))
