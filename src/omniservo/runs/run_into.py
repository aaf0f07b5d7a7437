"""A whole job into a folder: metrics, plan, log, images, figures, report."""

from __future__ import annotations

import json
from collections.abc import Sequence
from pathlib import Path

from omniservo.errors import NoSolutionError
from omniservo.files import write_whole
from omniservo.files.image_files import write_png
from omniservo.recording import RunRecording
from omniservo.reporting.animation import animation_bytes
from omniservo.reporting.figure_files import write_drawings
from omniservo.reporting.write_figures import drawings
from omniservo.reporting.write_report import RunPictures, write_report
from omniservo.results.run_result import RunResult
from omniservo.run_methods import run_methods
from omniservo.runs.job_progress import JobProgress, Progress
from omniservo.runs.robot_cell import OpenCell
from omniservo.runs.run_inputs import RunInputs
from omniservo.runs.run_task import run_task
from omniservo.tasks import Task, TaughtGoal


def run_into(
    folder: Path,
    task: Task,
    open_cell: OpenCell,
    *,
    method: str | Sequence[str] = "certified",
    goal: TaughtGoal | None = None,
    seed: int = 0,
    filmed: bool = True,
    progress: Progress = lambda stage, done: None,
) -> dict[str, dict[str, object]]:
    """Run a task and leave everything that interface files promise in ``folder``; return metrics by method.

    Of several methods the folder holds the first run, each other run has a folder of its own below it, and
    the report shows them side by side. One that refuses the task, `NoSolutionError`, has metrics with the
    status "refused" and the reason; if all do, that of the first is raised.

    Args:
        folder: an empty one.
        task: the job.
        open_cell: says where it is done.
        method: one or several, as `omniservo.run_methods.run_methods` takes them.
        goal: what `teach_goal` saved; None: taught now.
        seed: of everything random.
        filmed: whether there is an animation.
        progress: called with what is being done, and the share of the whole job that is behind.

    Raises:
        InputError, NoSolutionError: as `run_task`.
    """
    methods = run_methods([method] if isinstance(method, str) else method)
    job = JobProgress(progress, tuple(each.name for each in methods), filmed=filmed)
    results: list[RunResult] = []
    pictures: list[RunPictures] = []
    refusals: dict[str, NoSolutionError] = {}
    for number, each in enumerate(methods):
        job.begin_run(number)
        called = each.source or each.name
        try:
            result = run_task(
                task, open_cell, method=called, goal=goal, seed=seed, filmed=filmed, progress=job
            )
        except NoSolutionError as refusal:
            refusals[each.name] = refusal
            continue
        target = folder / each.name if results else folder
        results.append(result)
        target.mkdir(exist_ok=True)
        pictures.append(_write(result, target, job))
    if not results:
        raise next(iter(refusals.values()))
    job.report()
    reasons = {name: str(refusal) for name, refusal in refusals.items()}
    write_report(folder, results, pictures, reasons)
    found = {result.method: result.metrics for result in results}
    for name, reason in reasons.items():
        found[name] = {"task": task.name, "method": name, "status": "refused", "reason": reason}
    return {each.name: found[each.name] for each in methods}


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
    job = JobProgress(progress, ("certified",), filmed=filmed)
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
    RunInputs.now(result.method, seed, kept).write(folder)
