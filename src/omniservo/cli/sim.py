"""``omniservo sim``."""

from __future__ import annotations

import time
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal

import typer

from omniservo.cli.camera_options import size_from_text
from omniservo.cli.completion import task_names
from omniservo.cli.grouped import grouped
from omniservo.cli.output import ForceOption, Output, SeedOption
from omniservo.cli.robot_options import TaskOptions
from omniservo.errors import InputError
from omniservo.files import writable, write_whole
from omniservo.geometry.arrays import finite_number
from omniservo.shipped_tasks import task_file

if TYPE_CHECKING:
    from omniservo.simulation import RealTimeRobot
    from omniservo.tasks import Task

app = typer.Typer(
    help="Rehearse: the simulated arm and camera in the place of real ones.", no_args_is_help=True
)

_SQUEEZED = 0.02
"""Sides may differ so much from the image's before: whole pixels."""

_SAID_AGAIN = 10.0
"""That rendering is too slow is said so often [s]."""


@dataclass(frozen=True)
class _Link:
    """What is wrong with the link to the arm, and with its clock."""

    latency: Annotated[float, typer.Option("--latency", min=0, help="Of messages, in s.")] = 0.0
    jitter: Annotated[float, typer.Option("--jitter", min=0, help="Of the latency, either way, in s.")] = 0.0
    loss: Annotated[float, typer.Option("--loss", min=0, max=1, help="Share of messages lost.")] = 0.0
    clock_offset: Annotated[float, typer.Option("--clock-offset", help="Of its clock, in s.")] = 0.0
    drift: Annotated[float, typer.Option("--drift", help="Of its clock, in ppm.")] = 0.0


@dataclass(frozen=True)
class _Images:
    """What the camera's images are, in place of what the task says."""

    rate: Annotated[float | None, typer.Option("--rate", help="Frames a second; replaces the task's.")] = None
    size: Annotated[
        str | None, typer.Option("--size", help="WIDTHxHEIGHT of images; the task's camera, smaller.")
    ] = None
    projected: Annotated[
        bool,
        typer.Option("--projected", help="Images show the dots alone, drawn at once: for tests of time."),
    ] = False

    def of(self, task: Task) -> Task:
        """Return the task with such images."""
        sides = None if self.size is None else size_from_text("--size", self.size)
        task = task if self.rate is None else _at_rate(task, self.rate)
        return task if sides is None else _of_size(task, *sides)


@app.callback()
def _sim() -> None:
    """Rehearse: a simulated arm and camera in the place of real ones."""


@app.command("serve")
@grouped
def serve(
    task: Annotated[str, typer.Argument(help="A shipped task or a YAML file.", autocompletion=task_names)],
    *,
    interface: Annotated[
        Literal["rtde", "ros2"], typer.Option("--as", help="rtde: Universal Robots and MJPEG; ros2: topics.")
    ] = "rtde",
    at: Annotated[
        Literal["start", "goal"], typer.Option("--at", help="Where the arm stands; at the goal it is taught.")
    ] = "start",
    robot_file: Annotated[
        Path | None, typer.Option("--robot-file", help="Write the robot file that reaches it here.")
    ] = None,
    link: _Link,
    images: _Images,
    seconds: Annotated[float | None, typer.Option("--seconds", min=0, help="End after so long.")] = None,
    free_ports: Annotated[bool, typer.Option("--free-ports", help="Any ports that are free.")] = False,
    files: TaskOptions,
    seed: SeedOption = 0,
    force: ForceOption = False,
    output: Output,
) -> None:
    """Serve a task's simulated arm and camera on the wall clock, behind the interfaces of real ones.

    It goes on until Ctrl-C; --json prints its object once it serves. omniservo run TASK --on ROBOT.yaml then
    works on it as on a real robot.
    """
    task_file(task)
    if robot_file is not None:
        writable(robot_file, force=force)
    with output.working("loading") as progress:
        from omniservo.hardware import LinkFaults
        from omniservo.simulation.sim_server import serve as served

        faults = LinkFaults(link.latency, link.jitter, link.loss, link.clock_offset, link.drift, seed)
        loaded = images.of(files.load(task))
        progress("starting")
    with served(
        loaded, interface, at=at, faults=faults, free_ports=free_ports, seed=seed, projected=images.projected
    ) as there:
        if robot_file is not None:
            write_whole(robot_file, there.robot_file, force=force)
            output.written(robot_file)
        output.line(f"serving {loaded.name}, the arm at its {at}: {there.where}; Ctrl-C ends it")
        reached = None if robot_file is None else str(robot_file)
        output.result(
            {"task": loaded.name, "at": at, "where": there.where, "robot_file": reached}, "sim-serve"
        )
        _watch(there.robot, seconds, output)


def _watch(robot: RealTimeRobot, seconds: float | None, output: Output) -> None:
    """Say where it is too slow, until the end."""
    end, said = float("inf") if seconds is None else time.monotonic() + seconds, float("-inf")
    while time.monotonic() < end:
        time.sleep(0.2)
        behind = robot.behind
        if behind is not None and time.monotonic() - said > _SAID_AGAIN:
            said = time.monotonic()
            output.line(behind)


def _of_size(task: Task, width: int, height: int) -> Task:
    """Return the task with images of another size, of the same lens.

    Raises:
        InputError: of other sides, or a lens that is not stated by focal lengths and centre.
    """
    from omniservo.cameras.models import camera_from_dict

    camera, truth = task.camera, task.simulation.true_camera
    if truth is not None or not all(hasattr(camera, name) for name in ("fx", "fy", "cx", "cy")):
        raise InputError(f"--size: the camera of {task.name} cannot be scaled; --rate can be lower")
    across, down = width / camera.width, height / camera.height
    if not 0 < width <= camera.width or abs(down / across - 1.0) > _SQUEEZED:
        legal = f"at most {camera.width}x{camera.height}, and of its shape"
        raise InputError(f"--size: {width}x{height} given; legal: {legal}")
    lens = camera.to_dict() | {"width": width, "height": height}
    for focal, centre, share in (("fx", "cx", across), ("fy", "cy", down)):
        lens[focal] = share * getattr(camera, focal)
        lens[centre] = share * (getattr(camera, centre) + 0.5) - 0.5
    return task.model_copy(update={"camera": camera_from_dict(lens)})


def _at_rate(task: Task, rate: float) -> Task:
    """Return the task with another frame rate [Hz].

    Raises:
        InputError: not above 0, or frames that follow one another faster than they are exposed.
    """
    from omniservo.tasks.sensor import untimely

    sensor = task.sensor
    finite_number("--rate", rate, above=0.0, maximum=1000.0)
    if problem := untimely(rate, sensor.latency, sensor.exposure, sensor.readout):
        raise InputError(f"--rate: {rate:g} given: {problem}")
    return task.model_copy(update={"sensor": sensor.model_copy(update={"rate": rate})})
