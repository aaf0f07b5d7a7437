"""How the camera commands are told which camera is meant."""

from __future__ import annotations

from typing import TYPE_CHECKING, Annotated

import typer

from omniservo.errors import InputError, spelled

if TYPE_CHECKING:
    from omniservo.cameras.models import CentralModel

NameOption = Annotated[str | None, typer.Option("--name", help="Which camera of a file with several.")]
SizeOption = Annotated[
    str | None, typer.Option("--size", help="Image size WIDTHxHEIGHT, for a file that does not say it.")
]
ModelOption = Annotated[
    str | None,
    typer.Option(
        "--model", help="pinhole or fisheye, for an OpenCV file whose four numbers may be either's."
    ),
]


def open_camera(camera: str, name: str | None, size: str | None, model: str | None) -> CentralModel:
    """Return a preset, or the camera of a file."""
    from omniservo.calibration import load_model
    from omniservo.cameras import PRESETS, preset

    if camera in PRESETS and name is None and size is None and model is None:
        return preset(camera)
    return load_model(
        camera, name=name, size=None if size is None else size_from_text("--size", size), model=model
    )


def size_from_text(option: str, text: str) -> tuple[int, int]:
    """Return (width, height) of a text like 640x480."""
    sides = text.lower().split("x")
    if len(sides) != 2 or not all(side.isascii() and side.isdigit() and len(side) < 7 for side in sides):
        raise InputError(f"{option}: {spelled(text)} given; legal: WIDTHxHEIGHT, such as 640x480")
    return int(sides[0]), int(sides[1])
