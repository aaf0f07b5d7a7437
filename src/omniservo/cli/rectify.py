"""``omniservo camera rectify``."""

from __future__ import annotations

import math
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal

import typer

from omniservo.cli.camera_options import CameraArgument, CameraFile, refuse_other_size, size_from_text
from omniservo.cli.grouped import grouped
from omniservo.cli.output import ForceOption, Output
from omniservo.errors import InputError
from omniservo.files import writable

if TYPE_CHECKING:
    from omniservo.cameras.rectify import ViewCamera

_SIZES = {
    "perspective": (960, 720),
    "tangent": (960, 720),
    "cylindrical": (1440, 720),
    "equirectangular": (1440, 720),
}


@grouped
def rectify(
    camera: CameraArgument,
    image: Annotated[Path, typer.Argument(help="An image of that camera.")],
    out: Annotated[Path, typer.Argument(help="Where to write (PNG).")],
    *,
    view: Annotated[
        Literal["perspective", "cylindrical", "equirectangular", "tangent"],
        typer.Option(
            "--view",
            help="perspective (or tangent): straight lines are straight; cylindrical: upright ones are.",
        ),
    ] = "perspective",
    direction: Annotated[
        str, typer.Option("--direction", help="Where it looks, camera frame: x,y,z with z ahead, y down.")
    ] = "0,0,1",
    up: Annotated[
        str | None, typer.Option("--up", help="What is up in the view, camera frame: x,y,z.")
    ] = None,
    field_of_view: Annotated[
        float | None,
        typer.Option("--field-of-view", help="Horizontal, degrees; perspective 90, cylindrical 180."),
    ] = None,
    view_size: Annotated[str | None, typer.Option("--view-size", help="WIDTHxHEIGHT, in px.")] = None,
    file: CameraFile,
    force: ForceOption = False,
    output: Output,
) -> None:
    """Resample an image into a perspective, cylindrical or equirectangular view."""
    if view == "equirectangular" and field_of_view is not None:
        raise InputError("--field-of-view: given; an equirectangular view shows the whole sphere")
    shape = _SIZES[view] if view_size is None else size_from_text("--view-size", view_size)
    ahead, above = _vector("--direction", direction), None if up is None else _vector("--up", up)
    writable(out, force=force)
    with output.working("loading") as progress:
        from omniservo.cameras.rectify import rectify as rectified
        from omniservo.files.image_files import read_image, write_png

        source, pixels = file.open(camera), read_image(image)
        refuse_other_size(image, pixels, source)
        progress("resampling")
        seen = rectified(source, pixels, _view(view, field_of_view, shape), direction=ahead, up=above)
    write_png(seen.image, out, force=force)
    share = float(seen.valid.mean())
    output.written(out, f"; the camera sees {100.0 * share:.0f}% of it")
    output.result({"out": str(out), "view": view, "size": list(shape), "seen": share}, "camera-rectify")


def _view(view: str, field_of_view: float | None, size: tuple[int, int]) -> ViewCamera:
    from omniservo.cameras.rectify import cylindrical_view, equirectangular_view, perspective_view

    if view == "equirectangular":
        return equirectangular_view(size)
    flat = view != "cylindrical"
    degrees = field_of_view if field_of_view is not None else 90.0 if flat else 180.0
    if not (0.0 < degrees < 180.0 if flat else 0.0 < degrees <= 360.0):
        legal = f"above 0, {'below 180' if flat else 'at most 360'} (degrees)"
        raise InputError(f"--field-of-view: {degrees:g} given; legal: {legal}")
    return (perspective_view if flat else cylindrical_view)(math.radians(degrees), size)


def _vector(option: str, text: str) -> list[float]:
    try:
        numbers = [float(part) for part in text.split(",")]
    except ValueError:
        numbers = []
    if len(numbers) != 3:
        raise InputError(f"{option}: {text!r:.60} given; legal: x,y,z")
    return numbers
