"""``omniservo teach``."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from omniservo.cli.camera_options import (
    CameraErrorOption,
    CameraOptions,
    LargestOption,
    MaxAngleOption,
    ModelOption,
    SizeOption,
)
from omniservo.cli.output import CameraNameOption, ForceOption, JsonOption, Output, QuietOption, SeedOption
from omniservo.cli.robot_options import AllowOutsideOption, PackageOption, packages_of
from omniservo.files import writable
from omniservo.shipped_tasks import task_file


def teach(
    task: Annotated[str, typer.Argument(help="A shipped task or a YAML file.")],
    out: Annotated[Path, typer.Option("--out", help="Write the taught goal here (JSON).")],
    camera: Annotated[str | None, typer.Option("--camera", help="Replaces the task's camera.")] = None,
    camera_name: CameraNameOption = None,
    size: SizeOption = None,
    model: ModelOption = None,
    max_angle: MaxAngleOption = None,
    largest_px: LargestOption = None,
    camera_error: CameraErrorOption = None,
    package: PackageOption = None,
    allow_outside: AllowOutsideOption = False,
    seed: SeedOption = 0,
    force: ForceOption = False,
    as_json: JsonOption = False,
    quiet: QuietOption = False,
) -> None:
    """Move the arm to the goal, take an image, save it with its features and the arm's joints."""
    output = Output(as_json, quiet)
    writable(out, force=force)
    task_file(task)
    with output.working("loading") as progress:
        from omniservo.runs import teach_goal
        from omniservo.simulation import SimulatedCell
        from omniservo.tasks import load_task

        progress("teaching")
        asked = CameraOptions(camera, camera_name, size, model, max_angle, largest_px, camera_error)
        loaded = load_task(
            task, camera=asked.opened(), packages=packages_of(package), allow_outside=allow_outside
        )
        goal = teach_goal(loaded, SimulatedCell(loaded, seed))
    goal.save(out, force=force)
    output.line(f"{len(goal.features)} features found in the goal image")
    output.written(out)
    output.result({"out": str(out), "features": goal.features, "joints": goal.joints})
