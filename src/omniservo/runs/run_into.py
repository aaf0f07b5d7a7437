"""A whole job into a folder: metrics, plan, log, images, figures, report."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Literal, cast

from omniservo.files import write_whole
from omniservo.files.image_files import write_png
from omniservo.recording import RunRecording
from omniservo.reporting.animation import animation_bytes
from omniservo.reporting.figure_files import write_drawings
from omniservo.reporting.write_figures import drawings
from omniservo.reporting.write_report import RunPictures, write_report
from omniservo.results.run_result import RunResult
from omniservo.runs.job_progress import JobProgress, Progress
from omniservo.runs.planned_job import Method
from omniservo.runs.robot_cell import OpenCell
from omniservo.runs.run_inputs import RunInputs
from omniservo.runs.run_task import run_task
from omniservo.tasks import Task, TaughtGoal

METHODS: tuple[Method, ...] = ("certified", "paper", "ibvs")
"""in the order of the comparison"""


def run_into(
    folder: Path,
    task: Task,
    open_cell: OpenCell,
    *,
    method: Literal["certified", "paper", "ibvs", "compare"] = "certified",
    goal: TaughtGoal | None = None,
    seed: int = 0,
    filmed: bool = True,
    progress: Progress = lambda stage, done: None,
) -> dict[str, dict[str, object]]:
    """Run a task and leave everything that interface files promise in ``folder``; return metrics by method.

    "compare" runs all methods: the folder holds the certified run, each other run has a folder of its own
    below it, and the report shows them side by side.

    Args:
        folder: an empty one.
        task: the job.
        open_cell: says where it is done.
        method: of planning.
        goal: what `teach_goal` saved; None: taught now.
        seed: of everything random.
        filmed: whether there is an animation.
        progress: called with what is being done, and the share of the whole job that is behind.

    Raises:
        InputError, NoSolutionError: as `run_task`.
    """
    methods = METHODS if method == "compare" else (method,)
    job = JobProgress(progress, methods, filmed=filmed)
    results, pictures = [], []
    for number, name in enumerate(methods):
        job.begin_run(number)
        result = run_task(task, open_cell, method=name, goal=goal, seed=seed, filmed=filmed, progress=job)
        results.append(result)
        target = folder if number == 0 else folder / name
        target.mkdir(exist_ok=True)
        pictures.append(_write(result, target, job))
    job.report()
    write_report(folder, results, pictures)
    return {result.method: result.metrics for result in results}


def run_recorded_into(
    folder: Path,
    task: Task,
    open_cell: OpenCell,
    recording: RunRecording,
    *,
    goal: TaughtGoal,
    seed: int = 0,
    filmed: bool = True,
    progress: Progress = lambda stage, done: None,
) -> dict[str, dict[str, object]]:
    """Do the certified run alone, as `run_into`; ``recording`` takes it in.

    Raises:
        InputError, NoSolutionError: as `run_task`.
    """
    job = JobProgress(progress, METHODS[:1], filmed=filmed)
    job.begin_run(0)
    result = run_task(task, open_cell, goal=goal, seed=seed, filmed=filmed, progress=job, recording=recording)
    pictures = _write(result, folder, job)
    job.report()
    write_report(folder, [result], [pictures])
    return {result.method: result.metrics}


def _write(result: RunResult, folder: Path, progress: Progress) -> RunPictures:
    """Write everything but the report; return the images, which it shows again."""
    write_whole(folder / "metrics.json", json.dumps(result.metrics, indent=2, allow_nan=False) + "\n")
    write_whole(folder / "log.csv", result.log.to_csv())
    result.estimate.save(folder / "estimate.json")
    if result.plan is not None:
        result.plan.save(folder / "plan.json")
    for number, plan in enumerate((e.plan for e in result.replannings if e.plan is not None), start=2):
        plan.save(folder / f"plan-{number}.json")
    result.goal.save(folder / "goal.json")
    _keep_inputs(result, folder)
    for name, image in {
        "initial": result.seen.initial_image,
        "goal": result.goal.image,
        "final": result.final_image,
    }.items():
        write_png(image, folder / f"{name}.png")
    for number, look in enumerate(result.looks, start=1):
        write_png(look.image, folder / f"look-{number}.png")
    progress("drawing figures", 0.0)
    drawn = tuple(drawings(result))
    write_drawings(drawn, folder)
    if not result.is_filmed:
        return RunPictures(drawn, None)
    progress("drawing the animation", 0.0)
    animation = animation_bytes(result)
    write_whole(folder / "recording.gif", animation, force=True)
    return RunPictures(drawn, animation)


def _keep_inputs(result: RunResult, folder: Path) -> None:
    """Keep what the run can be done again from, where its task came from a file and no real robot did it."""
    task, seed = result.task, result.metrics["seed"]
    if result.truth is None or task.sources is None or not isinstance(seed, int):
        return
    kept = task.sources.kept(task)
    RunInputs.now(cast(Method, result.method), seed, kept).write(folder)
