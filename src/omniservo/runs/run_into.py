"""A whole job into a folder: metrics, plan, log, images, figures, report."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path
from typing import Literal

from PIL import Image

from omniservo.files import write_whole
from omniservo.reporting import write_animation, write_figures, write_report
from omniservo.runs.run_task import Method, run_task
from omniservo.simulation.run_result import RunResult
from omniservo.tasks import Task, TaughtGoal

METHODS: tuple[Method, ...] = ("certified", "paper", "ibvs")
"""in the order of the comparison"""


def run_into(
    folder: Path,
    task: Task,
    *,
    method: Literal["certified", "paper", "ibvs", "compare"] = "certified",
    goal: TaughtGoal | None = None,
    seed: int = 0,
    progress: Callable[[str], object] = lambda words: None,
) -> dict[str, object]:
    """Run a task and leave everything that interface files promise in ``folder``; return the metrics.

    "compare" runs all methods: the folder holds the certified run, each other run has a folder of its own
    below it, and the report shows them side by side.

    Raises:
        InputError, AnswerIsNo: as `run_task`.
    """
    methods = METHODS if method == "compare" else (method,)
    results = []
    for name in methods:
        result = run_task(task, method=name, goal=goal, seed=seed, progress=progress)
        results.append(result)
        progress(f"writing the {name} run")
        target = folder if name == methods[0] else folder / name
        target.mkdir(exist_ok=True)
        _write(result, target)
    write_report(folder, results)
    return results[0].metrics


def _write(result: RunResult, folder: Path) -> None:
    """Everything but the report."""
    write_whole(folder / "metrics.json", json.dumps(result.metrics, indent=2, allow_nan=False) + "\n")
    write_whole(folder / "log.csv", result.log.to_csv())
    result.estimate.save(folder / "estimate.json")
    if result.plan is not None:
        result.plan.save(folder / "plan.json")
    for number, plan in enumerate((e.plan for e in result.replannings if e.plan is not None), start=2):
        plan.save(folder / f"plan-{number}.json")
    result.goal.save(folder / "goal.json")
    for name, image in {
        "initial": result.seen.initial_image,
        "goal": result.goal.image,
        "final": result.final_image,
    }.items():
        Image.fromarray(image).save(folder / f"{name}.png")
    write_figures(result, folder)
    write_animation(result, folder / "recording.gif")
