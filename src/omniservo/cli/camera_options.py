"""How the camera commands are given a camera."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING, Annotated

import typer

from omniservo.cli.completion import camera_names
from omniservo.errors import InputError, spelled

if TYPE_CHECKING:
    from omniservo.cameras.models import CentralModel

LARGEST_PX = 1.0
_HALF_TURN = 180.0
_LARGEST_ERROR_PX = 100.0

CameraArgument = Annotated[
    str, typer.Argument(help="A calibration file or a preset's name.", autocompletion=camera_names)
]
SizeOption = Annotated[
    str | None, typer.Option("--size", help="Image size WIDTHxHEIGHT, for a file that does not say it.")
]
ModelOption = Annotated[
    str | None,
    typer.Option(
        "--model",
        help="pinhole or fisheye, for a file of OpenCV, or ost.txt, whose four numbers may be either's.",
    ),
]


MaxAngleOption = Annotated[
    float | None,
    typer.Option(
        "--max-angle", help="How far from its axis the lens sees, in degrees, where the file says more."
    ),
]
LargestOption = Annotated[
    float | None,
    typer.Option("--largest-px", help="Refuse a camera whose nearest converted one is farther off, in px."),
]


CameraErrorOption = Annotated[
    float | None,
    typer.Option(
        "--camera-error",
        help="How far the camera's model is off, in px (1 sigma, alike over regions); else as its file says.",
    ),
]


def open_model(
    camera: str,
    name: str | None,
    size: str | None,
    model: str | None,
    max_angle: float | None = None,
    camera_error: float | None = None,
) -> CentralModel:
    """Return a preset, or the camera of a file as it stands there."""
    from omniservo.camera_files import named_model

    stated = None if size is None else size_from_text("--size", size)
    return named_model(
        camera, name=name, size=stated, model=model, max_angle=_radians(max_angle),
        camera_error=_checked_error(camera_error),
    )  # fmt: skip


@dataclass(frozen=True)
class CameraOptions:
    """Which camera a command is given, in the words of its options."""

    camera: str | None
    name: str | None = None
    size: str | None = None
    model: str | None = None
    max_angle: float | None = None
    largest_px: float | None = None
    camera_error: float | None = None

    def opened(self) -> CentralModel | None:
        """Return the camera of a preset or a file as it stands there, or None where none is named.

        Raises:
            InputError: no such camera, options without a camera, or its unified form, with which paths are
                planned, is farther away than ``--largest-px``.
        """
        if self.camera is not None:
            return self.opened_from(self.camera)
        options = {
            "--camera-name": self.name, "--size": self.size, "--model": self.model,
            "--max-angle": self.max_angle, "--largest-px": self.largest_px,
            "--camera-error": self.camera_error,
        }  # fmt: skip
        given = [option for option, value in options.items() if value is not None]
        if given:
            raise InputError(f"{given[0]}: given without --camera")
        return None

    def opened_from(self, camera: str) -> CentralModel:
        """Return the camera that a preset's or a file's name stands for."""
        found = open_model(camera, self.name, self.size, self.model, self.max_angle, self.camera_error)
        if self.largest_px is not None:
            from omniservo.camera_files.camera_files import as_unified

            as_unified(found, camera, self.largest_px)
        return found


def _checked_error(camera_error: float | None) -> float | None:
    """Return ``--camera-error`` [px]."""
    if camera_error is not None and not 0.0 <= camera_error <= _LARGEST_ERROR_PX:
        raise InputError(f"--camera-error: {camera_error:g} given; legal: 0 to {_LARGEST_ERROR_PX:g} (px)")
    return camera_error


def _radians(max_angle: float | None) -> float | None:
    """Return ``--max-angle`` [rad]."""
    if max_angle is None:
        return None
    if not 0.0 < max_angle <= _HALF_TURN:
        raise InputError(f"--max-angle: {max_angle:g} given; legal: > 0, <= {_HALF_TURN:g} (degrees)")
    return math.radians(max_angle)


def size_from_text(option: str, text: str) -> tuple[int, int]:
    """Return (width, height) of a text like 640x480."""
    sides = text.lower().split("x")
    if len(sides) != 2 or not all(side.isascii() and side.isdigit() and len(side) < 7 for side in sides):
        raise InputError(f"{option}: {spelled(text)} given; legal: WIDTHxHEIGHT, such as 640x480")
    return int(sides[0]), int(sides[1])
