"""``omniservo teach``."""

from __future__ import annotations

from contextlib import closing
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
from omniservo.cli.completion import camera_names, task_names
from omniservo.cli.output import CameraNameOption, ForceOption, JsonOption, Output, QuietOption, SeedOption
from omniservo.cli.robot_file import CameraSourceOption, DriverOption, OnOption, robot_of
from omniservo.cli.robot_options import AllowOutsideOption, PackageOption, packages_of
from omniservo.errors import NoSolutionError
from omniservo.files import writable
from omniservo.shipped_tasks import task_file

CameraOption = Annotated[
    str | None,
    typer.Option("--camera", help="Replaces the task's camera.", autocompletion=camera_names),
]


def teach(
    task: Annotated[str, typer.Argument(help="A shipped task or a YAML file.", autocompletion=task_names)],
    out: Annotated[Path, typer.Option("--out", help="Write the taught goal here (JSON).")],
    camera: CameraOption = None,
    camera_name: CameraNameOption = None,
    size: SizeOption = None,
    model: ModelOption = None,
    max_angle: MaxAngleOption = None,
    largest_px: LargestOption = None,
    camera_error: CameraErrorOption = None,
    package: PackageOption = None,
    allow_outside: AllowOutsideOption = False,
    seed: SeedOption = 0,
    on: OnOption = None,
    camera_source: CameraSourceOption = None,
    driver: DriverOption = None,
    force: ForceOption = False,
    as_json: JsonOption = False,
    quiet: QuietOption = False,
) -> None:
    """Save the goal image with its features and the arm's joints; a real arm (--on) stands at the goal."""
    output = Output(as_json, quiet)
    writable(out, force=force)
    task_file(task)
    with output.working("loading") as progress:
        from omniservo.runs import teach_goal, teach_here
        from omniservo.tasks import load_task

        progress("teaching")
        asked = CameraOptions(camera, camera_name, size, model, max_angle, largest_px, camera_error)
        loaded = load_task(
            task, camera=asked.opened(), packages=packages_of(package), allow_outside=allow_outside
        )
        if on is None:
            from omniservo.simulation import SimulatedCell

            goal = teach_goal(loaded, SimulatedCell(loaded, seed))
        else:
            from omniservo.runs.open_hardware import open_hardware

            robot = robot_of(on, camera_source, None, allow_outside=allow_outside)
            begun, cell = open_hardware(loaded, robot, _nothing_moves, driver)
            with closing(cell):
                goal = teach_here(begun, cell)
    goal.save(out, force=force)
    output.line(f"{len(goal.features)} features found in the goal image")
    output.written(out)
    output.result({"out": str(out), "features": goal.features, "joints": goal.joints}, "teach")


def _nothing_moves(motion: str) -> None:
    raise NoSolutionError(f"teach moves no real arm, and was to: {motion}")
