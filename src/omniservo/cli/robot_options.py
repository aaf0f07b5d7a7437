"""What commands share that read an arm's file, or a task with one."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Annotated

import typer

from omniservo.errors import InputError, spelled

if TYPE_CHECKING:
    from pathlib import Path

    from omniservo.cameras.models import CentralModel
    from omniservo.tasks import Task

PackageOption = Annotated[
    list[str] | None,
    typer.Option("--package", help="NAME=FOLDER: where a ROS package is; may be given several times."),
]

AllowOutsideOption = Annotated[
    bool,
    typer.Option("--allow-outside", help="Files that the task names may lie outside its folder."),
]


@dataclass(frozen=True)
class TaskOptions:
    """Where the files are that a task names."""

    package: PackageOption = None
    allow_outside: AllowOutsideOption = False

    def load(self, task: str | Path, camera: CentralModel | None = None) -> Task:
        """Load a task; ``camera`` replaces its own."""
        from omniservo.tasks import load_task

        known = packages_of(self.package)
        return load_task(task, camera=camera, packages=known, allow_outside=self.allow_outside)


def packages_of(given: list[str] | None) -> dict[str, str]:
    """Return folders by the packages' names.

    Raises:
        InputError: not NAME=FOLDER.
    """
    return dict(_parted(text, "=", "--package", "NAME=FOLDER") for text in given or ())


def arguments_of(given: list[str] | None) -> dict[str, str]:
    """Return what ``NAME:=VALUE`` on a command line states.

    Raises:
        InputError: not of that form.
    """
    return dict(_parted(text, ":=", "ARGUMENTS", "NAME:=VALUE") for text in given or ())


def _parted(text: str, between: str, name: str, legal: str) -> tuple[str, str]:
    first, found, second = text.partition(between)
    if not (first and found):
        raise InputError(f"{name}: {spelled(text)} given; legal: {legal}")
    return first, second
