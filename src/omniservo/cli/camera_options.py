"""How commands are given a camera."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING, Annotated, Any

import typer

from omniservo.cli.completion import camera_names
from omniservo.errors import InputError, spelled

if TYPE_CHECKING:
    from pathlib import Path

    import numpy.typing as npt

    from omniservo.cameras.models import CentralModel

LARGEST_PX = 1.0
_HALF_TURN = 180.0
_LARGEST_ERROR_PX = 100.0

CameraArgument = Annotated[
    str, typer.Argument(help="A calibration file or a preset's name.", autocompletion=camera_names)
]
CameraOption = Annotated[
    str, typer.Option("--camera", help="A calibration file or a preset's name.", autocompletion=camera_names)
]
TaskCameraOption = Annotated[
    str | None,
    typer.Option("--camera", help="Replaces the task's camera.", autocompletion=camera_names),
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


@dataclass(frozen=True)
class CameraFile:
    """What a calibration file leaves open."""

    camera_name: Annotated[
        str | None, typer.Option("--camera-name", help="Which camera of a calibration file with several.")
    ] = None
    size: Annotated[
        str | None, typer.Option("--size", help="Image size WIDTHxHEIGHT, for a file that does not say it.")
    ] = None
    model: Annotated[
        str | None,
        typer.Option(
            "--model",
            help="pinhole or fisheye, for a file of OpenCV, or ost.txt, whose four numbers may be either's.",
        ),
    ] = None

    def open(
        self, camera: str, max_angle: float | None = None, camera_error: float | None = None
    ) -> CentralModel:
        """Return a preset, or the camera of a file as it stands there.

        Args:
            camera: the preset's or the file's name.
            max_angle: ``--max-angle`` [deg].
            camera_error: ``--camera-error`` [px].

        Raises:
            InputError: no such camera, or an option out of its range.
        """
        from omniservo.camera_files import named_model

        if max_angle is not None and not 0.0 < max_angle <= _HALF_TURN:
            raise InputError(f"--max-angle: {max_angle:g} given; legal: > 0, <= {_HALF_TURN:g} (degrees)")
        if camera_error is not None and not 0.0 <= camera_error <= _LARGEST_ERROR_PX:
            raise InputError(
                f"--camera-error: {camera_error:g} given; legal: 0 to {_LARGEST_ERROR_PX:g} (px)"
            )
        return named_model(
            camera,
            name=self.camera_name,
            size=None if self.size is None else size_from_text("--size", self.size),
            model=self.model,
            max_angle=None if max_angle is None else math.radians(max_angle),
            camera_error=camera_error,
        )


@dataclass(frozen=True)
class LensOptions(CameraFile):
    """`CameraFile`, and what the lens is said to be."""

    max_angle: MaxAngleOption = None
    camera_error: Annotated[
        float | None,
        typer.Option(
            "--camera-error",
            help="How far the camera's model is off, in px (1 sigma, alike over regions); "
            "else as its file says.",
        ),
    ] = None

    def opened(self, camera: str) -> CentralModel:
        """Return `CameraFile.open` with what the options say."""
        return self.open(camera, self.max_angle, self.camera_error)

    def opened_if_named(self, camera: str | None, largest_px: float | None = None) -> CentralModel | None:
        """Return `opened`, or None where no camera is named.

        Raises:
            InputError: no such camera, options without a camera, or its unified form, with which paths are
                planned, is farther away than ``largest_px``, that is ``--largest-px``.
        """
        if camera is None:
            given = {
                "--camera-name": self.camera_name, "--size": self.size, "--model": self.model,
                "--max-angle": self.max_angle, "--largest-px": largest_px,
                "--camera-error": self.camera_error,
            }  # fmt: skip
            for option, value in given.items():
                if value is not None:
                    raise InputError(f"{option}: given without --camera")
            return None
        found = self.opened(camera)
        if largest_px is not None:
            from omniservo.camera_files.camera_files import as_unified

            as_unified(found, camera, largest_px)
        return found


def refuse_other_size(path: Path, image: npt.NDArray[Any], camera: CentralModel) -> None:
    """Raise InputError where an image's size is not the camera's."""
    height, width = image.shape[:2]
    if (height, width) != (camera.height, camera.width):
        raise InputError(f"{path}: {width}×{height} px; the camera has {camera.width}×{camera.height}")


def size_from_text(option: str, text: str) -> tuple[int, int]:
    """Return (width, height) of a text like 640x480."""
    sides = text.lower().split("x")
    if len(sides) != 2 or not all(side.isascii() and side.isdigit() and len(side) < 7 for side in sides):
        raise InputError(f"{option}: {spelled(text)} given; legal: WIDTHxHEIGHT, such as 640x480")
    return int(sides[0]), int(sides[1])
