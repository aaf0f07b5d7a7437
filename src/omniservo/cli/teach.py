"""``omniservo teach``."""

from __future__ import annotations

from contextlib import closing
from pathlib import Path
from typing import Annotated

import typer

from omniservo.cli.camera_options import LargestOption, LensOptions, TaskCameraOption
from omniservo.cli.completion import task_names
from omniservo.cli.grouped import grouped
from omniservo.cli.output import ForceOption, Output, SeedOption
from omniservo.cli.robot_file import OnOption, RobotParts
from omniservo.cli.robot_options import TaskOptions
from omniservo.errors import NoSolutionError
from omniservo.files import writable
from omniservo.shipped_tasks import task_file


@grouped
def teach(
    task: Annotated[str, typer.Argument(help="A shipped task or a YAML file.", autocompletion=task_names)],
    *,
    out: Annotated[Path, typer.Option("--out", help="Write the taught goal here (JSON).")],
    camera: TaskCameraOption = None,
    lens: LensOptions,
    largest_px: LargestOption = None,
    files: TaskOptions,
    seed: SeedOption = 0,
    on: OnOption = None,
    parts: RobotParts,
    force: ForceOption = False,
    output: Output,
) -> None:
    """Save the goal image with its features and the arm's joints; a real arm (--on) stands at the goal."""
    writable(out, force=force)
    task_file(task)
    with output.working("loading") as progress:
        from omniservo.runs import teach_goal, teach_here

        progress("teaching")
        loaded = files.load(task, lens.opened_if_named(camera, largest_px))
        if on is None:
            from omniservo.simulation import SimulatedCell

            goal = teach_goal(loaded, SimulatedCell(loaded, seed))
        else:
            from omniservo.runs.open_hardware import open_hardware

            robot = parts.load(on, allow_outside=files.allow_outside)
            begun, cell = open_hardware(loaded, robot, _nothing_moves, parts.driver)
            with closing(cell):
                goal = teach_here(begun, cell)
    goal.save(out, force=force)
    found, dots = len(goal.features), len(loaded.target.dots)
    output.line(f"{found} features found in the goal image")
    if found < dots:
        output.line(
            f"notice: the target has {dots} dots; a run refuses images that share too few to be matched: "
            "does the camera see all of it from here?"
        )
    output.written(out)
    output.result({"out": str(out), "features": goal.features, "joints": goal.joints}, "teach")


def _nothing_moves(motion: str) -> None:
    raise NoSolutionError(f"teach moves no real arm, and was to: {motion}")
