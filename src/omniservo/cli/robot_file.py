"""What commands that work on a real robot share."""

from __future__ import annotations

import sys
from collections.abc import Iterator
from contextlib import closing, contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer
from rich.console import Console
from rich.prompt import Confirm

from omniservo.cli.progress import DOING
from omniservo.cli.robot_options import AllowOutsideOption
from omniservo.errors import InputError, NoSolutionError
from omniservo.geometry.arrays import finite_number

if TYPE_CHECKING:
    from omniservo.cli.progress import Progress
    from omniservo.runs import OpenCell
    from omniservo.tasks import RobotFile, Task

OnOption = Annotated[
    Path | None, typer.Option("--on", help="A robot file (YAML): work on that robot, not in the simulator.")
]
SpeedOption = Annotated[
    float | None,
    typer.Option("--speed", help="Share of the joints' speeds, 0 to 1; replaces the robot file's."),
]
YesOption = Annotated[bool, typer.Option("--yes", help="Move the real arm without a question.")]

_ASKING = "asking whether the arm may move; it stands still"
"""what is said to be done where somebody ends the program then: the stage before is that of the motion"""


@dataclass(frozen=True)
class RobotParts:
    """What replaces parts of a robot file."""

    camera_source: Annotated[
        str | None, typer.Option("--camera-source", help="URI of images; replaces the robot file's.")
    ] = None
    driver: Annotated[
        str | None, typer.Option("--driver", help="FILE.py:CLASS, a driver of your own: its code is run.")
    ] = None

    def load(self, path: Path, speed: float | None = None, *, allow_outside: bool) -> RobotFile:
        """Read a robot file.

        Raises:
            InputError: not a robot file, or no such share.
        """
        from omniservo.tasks import load_robot

        if speed is not None:
            finite_number("--speed", speed, above=0.0, maximum=1.0)
        return load_robot(path, camera_source=self.camera_source, speed=speed, allow_outside=allow_outside)

    def refuse(self) -> None:
        """Refuse options that go with a real robot where there is none.

        Raises:
            InputError: one was given.
        """
        for name, value in (("--camera-source", self.camera_source), ("--driver", self.driver)):
            if value is not None:
                raise InputError(f"{name}: goes with --on ROBOT.yaml")


class Approval:
    """Asks at the terminal before a real arm moves.

    Args:
        progress: stands still meanwhile: what it draws would cover the question.
        yes: everything is agreed to beforehand.

    Raises:
        InputError: no one can be required, and nothing was agreed to.
    """

    def __init__(self, progress: Progress, *, yes: bool) -> None:
        self._progress, self._yes = progress, yes
        if not (yes or sys.stdin.isatty()):
            raise InputError("--yes: not given, and nobody is at a terminal who could be asked")

    def __call__(self, motion: str) -> None:
        """Say what the arm is about to do, and go on where that is agreed to.

        Raises:
            NoSolutionError: it is not.
        """
        console = Console(stderr=True, highlight=False, emoji=False, soft_wrap=True)
        with self._progress.suspended():
            console.print(f"about to: {motion}", markup=False)
            stage, DOING.stage = DOING.stage, _ASKING
            agreed = self._yes or _is_agreed(console)
            DOING.stage = stage
        if not agreed:
            raise NoSolutionError("the motion was not agreed to, and not made")


def _is_agreed(console: Console) -> bool:
    try:
        return Confirm.ask("move the arm?", console=console, default=False)
    except EOFError:  # Ctrl-D is no answer
        return False


@dataclass(frozen=True)
class OnRobot(RobotParts):
    """The real robot that a command is to work on, if any."""

    on: OnOption = None
    speed: SpeedOption = None
    yes: YesOption = False
    allow_outside: AllowOutsideOption = False

    def refuse_mixed(self) -> None:
        """Refuse options that go with a real robot where there is none.

        Raises:
            InputError: one was given.
        """
        if self.on is None:
            self.refuse()
            if self.speed is not None:
                raise InputError("--speed: goes with --on ROBOT.yaml")

    def approval(self, progress: Progress) -> Approval | None:
        """Return what asks before a real arm moves; None for the simulator's."""
        return None if self.on is None else Approval(progress, yes=self.yes)

    @contextmanager
    def cell_of(self, task: Task, progress: Progress) -> Iterator[tuple[Task, OpenCell]]:
        """Have a task as it is done where it is done, and what opens that place.

        Raises:
            InputError, ServoStop: see `open_hardware`; or the robot was not checked.
        """
        approve = self.approval(progress)
        if self.on is None or approve is None:
            from omniservo.simulation import SimulatedCell

            yield task, SimulatedCell
            return
        from omniservo.runs.open_hardware import open_hardware
        from omniservo.runs.robot_records import require_check, stored_delay

        robot = self.load(self.on, self.speed, allow_outside=self.allow_outside)
        require_check(self.on, robot, self.driver)
        delay = stored_delay(self.on, robot, self.driver)
        progress("connecting to arm and camera")
        with progress.uncounted():
            begun, cell = open_hardware(task, robot, approve, self.driver, delay)
        with closing(cell):
            yield begun, lambda task, seed: cell
