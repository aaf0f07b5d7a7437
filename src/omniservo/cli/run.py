"""``omniservo run``."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Literal

import typer

from omniservo.cli.camera_options import LargestOption, MaxAngleOption, open_camera
from omniservo.cli.output import (
    CameraNameOption,
    ForceOption,
    JsonOption,
    Output,
    QuietOption,
    SeedOption,
    answer_is_no,
)


def run(
    task: Annotated[str, typer.Argument(help="A shipped task or a YAML file.")],
    out: Annotated[Path | None, typer.Option("--out", help="Folder of results; default runs/TASK.")] = None,
    method: Annotated[
        Literal["certified", "paper", "ibvs", "compare"],
        typer.Option("--method", help="compare runs all three and shows them side by side."),
    ] = "certified",
    goal: Annotated[Path | None, typer.Option("--goal", help="A goal saved by teach.")] = None,
    camera: Annotated[str | None, typer.Option("--camera", help="Replaces the task's camera.")] = None,
    camera_name: CameraNameOption = None,
    max_angle: MaxAngleOption = None,
    largest_px: LargestOption = None,
    seed: SeedOption = 0,
    force: ForceOption = False,
    as_json: JsonOption = False,
    quiet: QuietOption = False,
) -> None:
    """Do the whole job: images, estimate, plan, servo on the simulated arm, report."""
    from omniservo.files import whole_folder
    from omniservo.runs import run_into
    from omniservo.tasks import TaughtGoal, load_task

    output = Output(as_json, quiet)
    loaded = load_task(task, camera=open_camera(camera, camera_name, max_angle, largest_px))
    folder = out if out is not None else Path("runs") / loaded.name
    taught = None if goal is None else TaughtGoal.load(goal)
    with whole_folder(folder, force=force) as work, output.working("starting") as progress:
        metrics = run_into(work, loaded, method=method, goal=taught, seed=seed, progress=progress)
    for name, value in metrics.items():
        output.line(f"{name:<28} {_readable(value)}")
    output.line(f"written: {folder}/report.html")
    output.result({**metrics, "out": str(folder)})
    if metrics["status"] != "converged":
        raise answer_is_no(f"{metrics['status']}: {metrics['reason']}")


def _readable(value: object) -> str:
    return f"{value:.6g}" if isinstance(value, float) else str(value)
