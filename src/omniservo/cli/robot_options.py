"""What commands that read an arm's file share."""

from __future__ import annotations

from typing import Annotated

import typer

from omniservo.errors import InputError, spelled

PackageOption = Annotated[
    list[str] | None,
    typer.Option("--package", help="NAME=FOLDER: where a ROS package is; may be given several times."),
]

AllowOutsideOption = Annotated[
    bool,
    typer.Option("--allow-outside", help="Files that the task names may lie outside its folder."),
]


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
