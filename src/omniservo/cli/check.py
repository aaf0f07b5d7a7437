"""``omniservo camera check``."""

from __future__ import annotations

import math
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from omniservo.cli.camera_options import (
    CameraFile,
    CameraOption,
    LargestOption,
    MaxAngleOption,
    refuse_other_size,
)
from omniservo.cli.grouped import grouped
from omniservo.cli.output import Output, answer_is_no
from omniservo.files import require_file

if TYPE_CHECKING:
    from omniservo.calibration import CameraCheck


@grouped
def check(
    reference: Annotated[Path, typer.Argument(help="An image from when the camera stood right.")],
    now: Annotated[Path, typer.Argument(help="An image of now, of the same size.")],
    *,
    camera: CameraOption,
    file: CameraFile,
    max_angle: MaxAngleOption = None,
    largest_px: LargestOption = None,
    output: Output,
) -> None:
    """Tell whether a camera that watches a scene was moved: exit 0 if not, 1 if it was or is unknown."""
    for path in (reference, now):
        require_file(path)
    with output.working("loading") as progress:
        from omniservo.calibration import check_camera
        from omniservo.camera_files.camera_files import as_unified
        from omniservo.files.image_files import read_grey_image

        opened = file.open(camera, max_angle)
        if largest_px is not None:
            as_unified(opened, camera, largest_px)
        images = [read_grey_image(path) for path in (reference, now)]
        for path, image in zip((reference, now), images, strict=True):
            refuse_other_size(path, image, opened)
        progress("finding the reference again")
        found = check_camera(opened, *images)
    output.result(found.to_dict(), "camera-check")
    if found.moved is None:
        raise answer_is_no(f"whether the camera moved cannot be decided: {found.reason}")
    for line in _lines(found):
        output.line(line)
    if found.moved:
        turned, sigma = math.degrees(found.angle), math.degrees(found.sigma)
        raise answer_is_no(
            f"the camera moved: {found.displacement_px:.2f} px, {turned:.3f}° ± {sigma:.3f}°",
            "find again where it sits: omniservo robot calibrate-hand-eye, or put it back",
        )


def _lines(found: CameraCheck) -> list[str]:
    """Return what a person wants to know."""
    from omniservo.calibration.camera_check import FALSE_ALARM_RATE

    rotation = ", ".join(f"{math.degrees(x):+.4f}" for x in found.rotation)
    sigma = ", ".join(f"{math.degrees(math.sqrt(x)):.4f}" for x in found.covariance.diagonal()[:3])
    shift = ", ".join(f"{100 * x:+.2f}" for x in found.translation)
    spread = ", ".join(f"{100 * math.sqrt(x):.2f}" for x in found.covariance.diagonal()[3:])
    verdict = "moved" if found.moved else "not moved"
    return [
        f"{'camera':<14} {verdict}: {found.reason}",
        f"{'image':<14} {found.displacement_px:.3f} px (root mean square)",
        f"{'rotation':<14} {rotation} deg about x, y, z; one sigma {sigma}",
        f"{'displacement':<14} {shift} % of the scene's distance along x, y, z; one sigma {spread}",
        f"{'chance':<14} a camera that stands still shows as much with probability {found.probability:.2g};"
        f" false alarms: {FALSE_ALARM_RATE:.0%}",
    ]
