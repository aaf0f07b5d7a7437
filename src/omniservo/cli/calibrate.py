"""``omniservo camera calibrate``."""

from __future__ import annotations

import math
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal

import typer

from omniservo.cli.grouped import grouped
from omniservo.cli.live_views import LiveImages, LiveSourceOption, take_images
from omniservo.cli.output import ForceOption, Output
from omniservo.errors import NoSolutionError
from omniservo.files import writable

if TYPE_CHECKING:
    from omniservo.calibration import ImageCalibration
    from omniservo.cameras import UnifiedCamera

_BOARD = "checkerboard:8x6:0.042 (inner corners, square in m), charuco:…, aprilgrid:…, circles:…"


@grouped
def calibrate(
    images: Annotated[
        list[Path] | None, typer.Argument(help="Images of the board, all of one size; or --camera-source.")
    ] = None,
    *,
    board: Annotated[str, typer.Option("--board", help=_BOARD)],
    out: Annotated[Path | None, typer.Option("--out", help="Write the camera here.")] = None,
    report: Annotated[Path | None, typer.Option("--report", help="Write a report here (HTML).")] = None,
    distortion: Annotated[
        Literal["auto", "none", "radtan"],
        typer.Option("--distortion", help="auto: only where views left out get better by it."),
    ] = "auto",
    mirror: Annotated[
        bool | None, typer.Option("--mirror/--no-mirror", help="The camera looks into a mirror.")
    ] = None,
    camera_source: LiveSourceOption = None,
    live: LiveImages,
    force: ForceOption = False,
    output: Output,
) -> None:
    """Calibrate a camera from images of a board: files, or taken live while the board is held before it."""
    for path in (out, report):
        if path is not None:
            writable(path, force=force)
    folder = live.folder_for(images, camera_source, out)
    with output.working("loading"):
        from omniservo.calibration import board_from_text, calibrate_images
        from omniservo.camera_files import save_camera
        from omniservo.reporting import write_calibration_report

        target = board_from_text(board)
    files = images or []
    if folder is not None and camera_source is not None:
        files = take_images(camera_source, target, folder, output, seconds=live.seconds, force=force)
    with output.working("looking for the board") as say:
        result = calibrate_images(files, target, distortion=distortion, mirrored=mirror, progress=say)
    if report is not None:
        with output.working("writing the report"):
            write_calibration_report(result, report, force=force)
        output.written(report)
    if result.camera is None:
        seen = "" if report else "; next: --report FILE.html shows what was found in each image"
        raise NoSolutionError(f"{result.calibration.message}{seen}")
    if out is not None:
        save_camera(result.camera, out, force=force)
        output.written(out)
    for line in _lines(result):
        output.line(line)
    output.result(_fields(result, result.camera), "camera-calibrate")


def _lines(result: ImageCalibration) -> list[str]:
    """Return the calibration's own sentences, images by their names."""
    found = result.calibration
    lines = [line for line in found.report().splitlines() if not line.startswith("view ")]
    if result.mirrored:
        lines.append("the camera looks into a mirror: fy (and p1) of the file have the opposite sign")
    lines += [f"{result.images[i]}: not used: {reason}" for i, reason in sorted(result.not_used().items())]
    for k, corners in sorted(found.corners_dropped.items()):
        image = result.images[result.calibrated[k]]
        lines += [f"{image}: corner {row} not used: {reason}" for row, reason in corners.items()]
    return lines


def _fields(result: ImageCalibration, camera: UnifiedCamera) -> dict[str, Any]:
    found = result.calibration
    held = found.held_out
    return {
        "status": found.status,
        "camera": camera.to_dict(),
        "rms_px": found.rms_px,
        "held_out": None if held is None else {"px": held.px, "deg": held.deg},
        "deviation_px": found.deviation_px,
        "largest_angle": found.coverage.largest_angle,
        "image_fraction": found.coverage.image_fraction,
        "parameters": list(found.parameter_names),
        "covariance": [list(row) for row in camera.calibration_covariance or ()],
        "identifiable": found.identifiable,
        "used": [str(result.images[result.calibrated[k]]) for k in found.views_used],
        "not_used": {str(result.images[i]): reason for i, reason in sorted(result.not_used().items())},
        "seconds": found.seconds if math.isfinite(found.seconds) else None,
    }
