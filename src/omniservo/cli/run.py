"""``omniservo run``."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

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
from omniservo.cli.output import (
    CameraNameOption,
    ForceOption,
    JsonOption,
    Output,
    QuietOption,
    SeedOption,
    answer_is_no,
)
from omniservo.cli.replay import is_given, refuse_other_options
from omniservo.cli.replay import replay as replay_file
from omniservo.cli.replay_row import is_row, replay_row
from omniservo.cli.robot_file import (
    CameraSourceOption,
    DriverOption,
    OnOption,
    OnRobot,
    SpeedOption,
    YesOption,
)
from omniservo.cli.robot_options import AllowOutsideOption, PackageOption, packages_of
from omniservo.errors import AlreadyExists, InputError, NoSolutionError
from omniservo.files import exists, require_file, unused, whole_folder, write_whole
from omniservo.run_methods import COMPARE, RunMethod, run_methods
from omniservo.shipped_tasks import task_file

if TYPE_CHECKING:
    from omniservo.cli.progress import Progress
    from omniservo.runs import NoPath

_ROOM = 20 * 2**20
"""[bytes] that the results of one method may take"""


OutOption = Annotated[
    Path | None,
    typer.Option("--out", help="Folder of results; default runs/TASK, with a number where it exists."),
]
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
GoalOption = Annotated[Path | None, typer.Option("--goal", help="A goal saved by teach.")]
CameraOption = Annotated[
    str | None,
    typer.Option("--camera", help="Replaces the task's camera.", autocompletion=camera_names),
]
TaskArgument = Annotated[
    str | None, typer.Argument(help="A shipped task or a YAML file.", autocompletion=task_names)
]
FilmOption = Annotated[
    bool, typer.Option("--film/--no-film", help="Without the animation it takes less time.")
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
class _Call:
    """What a run is called with, but for the robot."""

    task: str
    out: Path | None
    methods: tuple[RunMethod, ...]
    goal: Path | None
    camera: CameraOptions
    package: list[str] | None
    allow_outside: bool
    seed: int
    film: bool
    force: bool


def run(
    context: typer.Context,
    task: TaskArgument = None,
    out: OutOption = None,
    method: MethodOption = ["certified"],  # noqa: B006
    goal: GoalOption = None,
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
    film: FilmOption = True,
    on: OnOption = None,
    camera_source: CameraSourceOption = None,
    driver: DriverOption = None,
    speed: SpeedOption = None,
    yes: YesOption = False,
    replay: ReplayOption = None,
    force: ForceOption = False,
    as_json: JsonOption = False,
    quiet: QuietOption = False,
) -> None:
    """Do the whole job: images, estimate, plan, servo on the simulated or a real arm, report."""
    output = Output(as_json, quiet)
    if replay is not None:
        if is_row(replay):
            refuse_other_options(context, "method")
            replay_row(replay, method if is_given(context, "method") else [], output)
            return
        refuse_other_options(context)
        replay_file(replay, allow_outside, output)
        return
    if task is None:
        raise InputError("TASK: missing; legal: a shipped task, a YAML file, or --replay FILE")
    lens = CameraOptions(camera, camera_name, size, model, max_angle, largest_px, camera_error)
    call = _Call(task, out, run_methods(method), goal, lens, package, allow_outside, seed, film, force)
    robot = OnRobot(on, camera_source, driver, speed, yes, allow_outside)
    _refuse_early(call, robot)
    with output.working("starting") as progress:
        progress("loading")  # no line of its own: a wrong call is one line
        folder, found = _done(call, robot, progress, output)
    _say(output, folder, found)


def _refuse_early(call: _Call, robot: OnRobot) -> None:
    """Refuse what is wrong without loading anything."""
    task_file(call.task)
    robot.refuse_mixed()
    names = [method.name for method in call.methods]
    if robot.file is not None and names != ["certified"]:
        raise InputError(f"--method: {', '.join(names)} given; a real arm follows certified plans alone")
    for method in call.methods:
        if method.source is not None:
            require_file(method.source.rpartition(":")[0])
    if robot.file is not None and call.goal is None:
        raise InputError("--goal: needed with --on: save one with omniservo teach TASK --on ROBOT --out GOAL")
    if call.out is not None and exists(call.out) and not call.force:
        raise AlreadyExists(call.out)
    if call.goal is not None:
        require_file(call.goal)


def _done(
    call: _Call, robot: OnRobot, progress: Progress, output: Output
) -> tuple[Path, dict[str, dict[str, object]]]:
    """Do the job; return where its results are, and the metrics by method."""
    from omniservo.runs import NoPath, recording_beside, run_into, run_recorded_into
    from omniservo.runs.compile_ahead import compiling_ahead
    from omniservo.tasks import TaughtGoal, load_task

    robot.approval()
    taught = None if call.goal is None else TaughtGoal.load(call.goal)
    replacement, known = call.camera.opened(), packages_of(call.package)
    loaded = load_task(call.task, camera=replacement, packages=known, allow_outside=call.allow_outside)
    folder = call.out if call.out is not None else _folder(loaded.name, call.methods, call.force)
    room = _ROOM * len(call.methods)
    try:
        with (
            compiling_ahead(),
            whole_folder(folder, force=call.force, room=room) as work,
            robot.cell_of(loaded, progress) as (begun, open_cell),
        ):
            if robot.file is None or taught is None:
                found = run_into(
                    work, begun, open_cell, method=[method.source or method.name for method in call.methods],
                    goal=taught, seed=call.seed, filmed=call.film, progress=progress,
                )  # fmt: skip
            else:
                with recording_beside(folder, work, output.written) as recording:
                    found = run_recorded_into(
                        work, begun, open_cell, recording, goal=taught, seed=call.seed, filmed=call.film,
                        progress=progress,
                    )  # fmt: skip
    except NoPath as refused:
        progress("drawing why", 0.9)
        raise NoSolutionError(f"{refused}{_drawn(refused, call.out)}") from None
    return folder, found


def _drawn(refused: NoPath, out: Path | None) -> str:
    """Draw why there is no path, beside the folder that was named and is not written; say where."""
    if out is None:
        return ""
    from omniservo.reporting.figure_files import image_bytes
    from omniservo.reporting.refused_run import draw_refused_run

    picture = out.with_name(f"{out.name}-refused.png")
    drawing = draw_refused_run(refused.plan, refused.scene, refused.setting, refused.posture)
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
