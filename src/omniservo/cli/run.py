"""``omniservo run``."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from omniservo.cli.camera_options import LargestOption, LensOptions, TaskCameraOption
from omniservo.cli.completion import task_names
from omniservo.cli.grouped import grouped
from omniservo.cli.output import ForceOption, Output, SeedOption, answer_is_no
from omniservo.cli.replay import is_given, refuse_other_options
from omniservo.cli.replay import replay as replay_file
from omniservo.cli.replay_row import is_row, replay_row
from omniservo.cli.robot_file import OnRobot
from omniservo.cli.robot_options import TaskOptions
from omniservo.errors import InputError, NoSolutionError
from omniservo.files import made_folder, require_file, unused, whole_folder, writable_folder, write_whole
from omniservo.run_methods import COMPARE, RunMethod, run_methods
from omniservo.shipped_tasks import task_file

if TYPE_CHECKING:
    from omniservo.cli.progress import Progress
    from omniservo.runs import NoPath
    from omniservo.tasks import Task

_METRICS = "metrics.json"
"""in every folder of results"""

_ROOM = 20 * 2**20
"""[bytes] that the results of one method may take"""


MethodOption = Annotated[
    list[str],
    typer.Option(
        "--method",
        metavar="NAME",
        help="certified, certified-once, paper, ibvs, ibvs-desired, ibvs-mean, bearing, spherical, pbvs, "
        "pbvs-target, hybrid-2.5d, switched, or FILE.py:CLASS, a method of your own: its code is run. Given "
        "several times they are shown side by side; compare stands for certified, paper, ibvs.",
    ),
]
TaskArgument = Annotated[
    str | None, typer.Argument(help="A shipped task or a YAML file.", autocompletion=task_names)
]
ReplayOption = Annotated[
    Path | None,
    typer.Option(
        "--replay",
        help="In place of a task: a recording, which is computed again and compared, or STUDY:ROW; for a row "
        "of a method of your own, with --method FILE.py:CLASS.",
    ),
]


@dataclass(frozen=True)
class _Results:
    """What is left of a run, and what it begins with."""

    out: Annotated[
        Path | None,
        typer.Option("--out", help="Folder of results; default runs/TASK, with a number where it exists."),
    ] = None
    goal: Annotated[Path | None, typer.Option("--goal", help="A goal saved by teach.")] = None
    seed: SeedOption = 0
    film: Annotated[
        bool, typer.Option("--film/--no-film", help="Without the animation it takes less time.")
    ] = True
    force: ForceOption = False


@grouped
def run(
    context: typer.Context,
    task: TaskArgument = None,
    *,
    method: MethodOption = ["certified"],  # noqa: B006
    camera: TaskCameraOption = None,
    lens: LensOptions,
    largest_px: LargestOption = None,
    files: TaskOptions,
    results: _Results,
    robot: OnRobot,
    replay: ReplayOption = None,
    output: Output,
) -> None:
    """Do the whole job: images, estimate, plan, servo on the simulated or a real arm, report."""
    if replay is not None:
        if is_row(replay):
            refuse_other_options(context, "method", "out", "force")
            own = method if is_given(context, "method") else []
            replay_row(replay, own, results.out, results.force, output)
            return
        refuse_other_options(context)
        replay_file(replay, files.allow_outside, output)
        return
    if task is None:
        raise InputError("TASK: missing; legal: a shipped task, a YAML file, or --replay FILE")
    methods = run_methods(method)
    _refuse_early(task, methods, results, robot)
    with output.working("starting") as progress:
        progress("loading")  # no line of its own: a wrong call is one line
        robot.approval(progress)
        loaded = files.load(task, lens.opened_if_named(camera, largest_px))
        folder, found = _done(loaded, methods, results, robot, progress, output)
    _say(output, folder, found)


def _refuse_early(task: str, methods: tuple[RunMethod, ...], results: _Results, robot: OnRobot) -> None:
    """Refuse what is wrong without loading anything."""
    task_file(task)
    robot.refuse_mixed()
    names = [method.name for method in methods]
    if robot.on is not None and names != ["certified"]:
        raise InputError(f"--method: {', '.join(names)} given; a real arm follows certified plans alone")
    for method in methods:
        if method.source is not None:
            require_file(method.source.rpartition(":")[0])
    if robot.on is not None and results.goal is None:
        raise InputError("--goal: needed with --on: save one with omniservo teach TASK --on ROBOT --out GOAL")
    if results.out is not None:
        writable_folder(results.out, _METRICS, force=results.force)
    if results.goal is not None:
        require_file(results.goal)


def _done(
    task: Task,
    methods: tuple[RunMethod, ...],
    results: _Results,
    robot: OnRobot,
    progress: Progress,
    output: Output,
) -> tuple[Path, dict[str, dict[str, object]]]:
    """Do the job; return where its results are, and the metrics by method."""
    from omniservo.runs import NoPath, recording_beside, run_into, run_recorded_into
    from omniservo.runs.compile_ahead import compiling_ahead
    from omniservo.tasks import TaughtGoal

    taught = None if results.goal is None else TaughtGoal.load(results.goal)
    folder = results.out if results.out is not None else _folder(task.name, methods, results.force)
    room = _ROOM * len(methods)
    seed, filmed = results.seed, results.film

    def left(recording: Path) -> None:
        with progress.suspended():
            output.written(recording)

    try:
        with (
            compiling_ahead(),
            whole_folder(folder, _METRICS, force=results.force, room=room) as work,
            robot.cell_of(task, progress) as (begun, open_cell),
        ):
            if robot.on is None or taught is None:
                found = run_into(
                    work, begun, open_cell, method=[method.source or method.name for method in methods],
                    goal=taught, seed=seed, filmed=filmed, progress=progress,
                )  # fmt: skip
            else:
                with recording_beside(folder, work, left) as recording:
                    found = run_recorded_into(
                        work, begun, open_cell, recording, goal=taught, seed=seed, filmed=filmed,
                        progress=progress,
                    )  # fmt: skip
    except NoPath as refused:
        progress("drawing why", 0.9)
        raise NoSolutionError(f"{refused}{_drawn(refused, results.out)}") from None
    return folder, found


def _drawn(refused: NoPath, out: Path | None) -> str:
    """Draw why there is no path, beside the folder that was named and is not written; say where."""
    if out is None:
        return ""
    from omniservo.reporting.figure_files import image_bytes
    from omniservo.reporting.refused_run import draw_refused_run

    picture = out.with_name(f"{out.name}-refused.png")
    drawing = draw_refused_run(refused.plan, refused.scene, refused.setting, refused.posture)
    with made_folder(picture.parent):
        write_whole(picture, image_bytes(drawing, "png"), force=True)
    return f"; drawn: {picture}"


def _folder(name: str, methods: tuple[RunMethod, ...], force: bool) -> Path:
    """Return where results go that have no stated place: such as runs/paper-example-1-compare-2."""
    called = COMPARE if len(methods) > 1 else methods[0].name
    folder = Path("runs") / (name if called == "certified" else f"{name}-{called}")
    return folder if force else unused(folder)


def _say(output: Output, folder: Path, found: dict[str, dict[str, object]]) -> None:
    """Say what came out; of several methods the first is the one that counts."""
    from omniservo.reporting.run_summary import how_it_ended, run_summary

    first, *others = found.values()
    for line in run_summary(first):
        output.line(line)
    for metrics in others:
        output.line(f"{metrics['method']:<22}{how_it_ended(metrics)}")
    output.written(folder / "report.html")
    compared = {"methods": found} if others else {}
    output.result({**first, "out": str(folder), **compared}, "run")
    if first["status"] != "converged":
        raise answer_is_no(how_it_ended(first))
