"""``omniservo camera``."""

from __future__ import annotations

import math
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from omniservo.cli.calibrate import calibrate
from omniservo.cli.camera_options import LARGEST_PX, CameraArgument, LargestOption, LensOptions
from omniservo.cli.check import check
from omniservo.cli.grouped import grouped
from omniservo.cli.output import ForceOption, Output, refuse_file
from omniservo.cli.rectify import rectify
from omniservo.errors import InputError, spelled
from omniservo.files import made_folder, writable

if TYPE_CHECKING:
    from omniservo.camera_files.mask_image import MaskCover
    from omniservo.cameras.conversion import Conversion, Residual
    from omniservo.cameras.models import CentralModel

app = typer.Typer(help="Calibrate, show, convert, rectify and check cameras.", no_args_is_help=True)
app.command("calibrate")(calibrate)
app.command("rectify")(rectify)
app.command("check")(check)

_UNITS = {
    **dict.fromkeys(("fx", "fy", "cx", "cy", "width", "height", "dead_zone", "mask", "deviation_px"), " px"),
    "max_angle": " rad",
}
"""of a camera's fields"""


@app.command("show")
@grouped
def show(
    camera: CameraArgument,
    *,
    lens: LensOptions,
    out: Annotated[
        Path | None, typer.Option("--out", help="Draw its field and its pixels a degree into this folder.")
    ] = None,
    output: Output,
) -> None:
    """Print a camera: its parameters, its domain, and how well the unified model fits it."""
    refuse_file(out)
    with output.working("loading") as progress:
        from omniservo.cameras.calibration_covariance import sigmas_in_words
        from omniservo.cameras.conversion import to_unified
        from omniservo.reporting.camera_field import past_right_angle

        shown = lens.opened(camera)
        progress("measuring its field of view")
        fields, behind = shown.to_dict(), past_right_angle(shown)
    for field, value in fields.items():
        if value is not None and field != "calibration_covariance":
            output.line(f"{field:<14} {_spelled_field(value)}{_UNITS.get(field, '')}")
    if (known := fields.get("calibration_covariance")) is not None:
        output.line(f"{'known to (1 σ)':<14} {sigmas_in_words(known)}")
    output.line(f"{'usable angle':<14} {math.degrees(shown.usable_angle):.3f} deg from the axis")
    output.line(f"{'past 90 deg':<14} {100.0 * behind:.1f}% of the image; the virtual plane loses it")
    result = {**fields, "usable_angle": shown.usable_angle, "past_right_angle": behind}
    unified = None
    try:
        with output.working("fitting the unified model"):
            conversion = to_unified(shown)
    except InputError as error:
        for warning in shown.warnings:
            output.line(f"{'warning':<14} {warning}")
        output.line(f"{'as unified':<14} none: {error}")
        result |= {"warnings": list(shown.warnings), "unified": None, "limits": None}
    else:
        unified = conversion.camera
        result |= _as_unified(shown, conversion, output)
    if out is not None:
        with output.working("drawing"):
            from omniservo.reporting.camera_field import draw_field
            from omniservo.reporting.figure_files import write_drawings

            with made_folder(out) as folder:
                drawn = write_drawings(draw_field(shown, unified), folder)
        for path in drawn:
            output.written(path)
    output.result(result, "camera-show")


def _as_unified(shown: CentralModel, conversion: Conversion, output: Output) -> dict[str, Any]:
    """Say how the unified model fits a camera, and what planning then keeps to."""
    from omniservo.cameras.polygon_shortfall import polygon_shortfall

    for warning in conversion.warnings:
        output.line(f"{'warning':<14} {warning}")
    if conversion.camera is not shown:
        output.line(f"{'as unified':<14} {conversion.residual}")
    limits = conversion.camera.image_limits()
    shortfall = polygon_shortfall(conversion.camera)
    if limits.polygon is None:
        output.line(f"{'limits':<14} {', '.join(limits.names)}")
    else:
        lost = f"leaves out {100.0 * shortfall:.2f}% of the image's usable part"
        output.line(f"{'limits':<14} domain, polygon of {len(limits.polygon)} sides, which {lost}")
    unified = {"camera": conversion.camera.to_dict(), **_numbers(conversion.residual)}
    return {
        "warnings": list(conversion.warnings),
        "unified": unified,
        "limits": list(limits.names),
        "polygon_shortfall": shortfall,
    }


@app.command("convert")
@grouped
def convert(
    camera: CameraArgument,
    out: Annotated[Path, typer.Argument(help="Where to write.")],
    *,
    to: Annotated[
        str,
        typer.Option(
            "--to",
            help="Format: own, mei, camodocal, kalibr, opencv, ros, basalt, ocamcalib, boofcv, colmap, visp.",
        ),
    ],
    lens: LensOptions,
    largest_px: LargestOption = None,
    mask: Annotated[
        Path | None,
        typer.Option(
            "--mask", help="An image, black where the camera sees itself or nothing; --to own only."
        ),
    ] = None,
    force: ForceOption = False,
    output: Output,
) -> None:
    """Convert a calibration file to another format, to the closest model that this holds."""
    writable(out, force=force)
    if mask is not None and to != "own":
        raise InputError(f"--mask: given with --to {spelled(to)}; legal: --to own")
    added: dict[str, Any] = {}
    cover: MaskCover | None = None
    with output.working("loading") as progress:
        from omniservo.camera_files import closest_model, save_camera

        given = lens.opened(camera)
        if mask is not None:
            progress("covering the mask's hidden pixels by polygons")
            given, cover = _masked(given, mask)
        progress(f"looking for the closest model that {spelled(to)} holds")
        allowed = LARGEST_PX if largest_px is None else largest_px
        found, residual = closest_model(given, to, largest_px=allowed)
    save_camera(found, out, to, force=force)
    if cover is not None:
        added = _said_of(cover, output)
    written = found.to_dict()["model"]
    output.written(out, f" ({written})")
    if residual is not None:
        output.line(f"residual: {residual}")
    if found.model_error is not None:
        output.line(f"model error: {found.model_error}, written with it; estimates count it")
    if found.deviation_px:
        output.line(f"deviation_px: {found.deviation_px:.3g}, written with it; plans keep it as a margin")
    numbers: dict[str, float] = {**_numbers(residual), "deviation_px": found.deviation_px}
    if known := given.to_dict().get("calibration_covariance"):
        numbers |= _said_of_parameters(known, found, output)
    output.result({"out": str(out), "to": to, "model": written, **numbers, **added}, "camera-convert")


def _masked(camera: CentralModel, path: Path) -> tuple[CentralModel, MaskCover]:
    """Return the camera with a mask image's polygons, and how these cover it."""
    from omniservo.camera_files.mask_image import load_mask
    from omniservo.cameras.models import camera_from_dict

    if camera.mask:
        raise InputError(f"--mask: {path} given, but the camera has a mask; legal: one of them")
    cover = load_mask(path, (camera.width, camera.height))
    fields = {**camera.to_dict(), "mask": [list(map(list, polygon)) for polygon in cover.polygons]}
    return camera_from_dict(fields, str(path)), cover


def _said_of(cover: MaskCover, output: Output) -> dict[str, Any]:
    """Say what a mask's polygons hide."""
    output.line(
        f"mask: {len(cover.polygons)} polygons over {cover.hidden_pixels} hidden pixels hide"
        f" {cover.lost_pixels} more, at most {cover.overhang_px:.1f} px away"
    )
    return {
        "mask_polygons": len(cover.polygons),
        "mask_lost_pixels": cover.lost_pixels,
        "mask_overhang_px": cover.overhang_px,
    }


def _said_of_parameters(known: Any, found: CentralModel, output: Output) -> dict[str, bool]:
    """Say what becomes of the covariance of a camera's parameters."""
    from omniservo.cameras.calibration_covariance import sigmas_in_words

    kept = found.to_dict().get("calibration_covariance") is not None
    if kept:
        output.line(
            f"calibration_covariance: {sigmas_in_words(known)} (1 σ), written with it; estimates count it"
        )
    else:
        output.line(
            f"calibration_covariance: left out, since it is that of the unified model's parameters, which a"
            f" {type(found).__name__} does not have; estimates with this file count its model error alone"
        )
    return {"calibration_covariance": kept}


def _spelled_field(value: object) -> str:
    """Spell a camera's field: numbers to seven digits, which is all that a calibration knows."""
    if isinstance(value, float):
        return f"{value:.7g}"
    if isinstance(value, dict):
        return ", ".join(f"{name} {_spelled_field(part)}" for name, part in value.items())
    return f"[{', '.join(map(_spelled_field, value))}]" if isinstance(value, list | tuple) else str(value)


def _numbers(residual: Residual | None) -> dict[str, float]:
    if residual is None:
        return {"largest_px": 0.0, "rms_px": 0.0, "largest_rad": 0.0, "lost": 0.0}
    names = ("largest_px", "rms_px", "largest_rad", "lost")
    return {name: getattr(residual, name) for name in names}
