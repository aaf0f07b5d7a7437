"""The HTML report of a calibration: one file that needs nothing else."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np

from omniservo.calibration import Calibration, ImageCalibration
from omniservo.calibration.adjustment.calibration import spelled_parameters
from omniservo.cameras import UnifiedCamera
from omniservo.files import write_whole
from omniservo.reporting.calibration_figures import calibration_drawings, view_residuals
from omniservo.reporting.camera_field import draw_field
from omniservo.reporting.framed_figure import framed
from omniservo.reporting.html import Markup, banner, judged, page, part, table, tag, tiles
from omniservo.reporting.residual_agreement import agreement_in_words
from omniservo.reporting.spelling import NOTHING, significant


def write_calibration_report(result: ImageCalibration, path: str | Path, *, force: bool = False) -> None:
    """Write the report; it holds its figures.

    Raises:
        InputError: the file exists and ``force`` is False, or it cannot be written.
    """
    write_whole(path, calibration_html(result), force=force)


def calibration_html(result: ImageCalibration) -> str:
    """Return the report's text."""
    found = result.calibration
    body = [
        banner(
            "Camera calibration", f"{len(result.images)} images of {result.size[0]} × {result.size[1]} px"
        ),
        judged(
            found.status == "ok",
            tag("strong", "Calibrated" if found.status == "ok" else "No camera"),
            *(tag("p", line) for line in found.report().splitlines()[:1]),
            *([tag("p", _what_is_left(result))] if result.camera is not None else []),
        ),
    ]
    if result.camera is not None:
        drawn = [*calibration_drawings(result), *draw_field(result.camera, result.camera)]
        body += [
            tiles(_numbers(found, result.camera)),
            part("The camera", _parameters(result), _words(result)),
            part("Figures", tag("div", *(framed(d, "half") for d in drawn), class_="figures")),
        ]
    body.append(part("Images", _images(result)))
    return page("camera calibration", body)


def _numbers(found: Calibration, camera: UnifiedCamera) -> list[tuple[str, str, str]]:
    held = found.held_out
    return [
        ("Left over", f"{significant(found.rms_px)} px", f"rms of {len(found.views_used)} views"),
        (
            "On views left out",
            NOTHING if held is None else f"{significant(held.deg)}°",
            "" if held is None else f"{significant(held.px)} px, the corners' noise included",
        ),
        (
            "Pixels are right within",
            f"{significant(camera.deviation_px)} px",
            "95%, anywhere in the camera's field; plans keep it as a margin",
        ),
        (
            "Model off by",
            NOTHING if camera.model_error is None else f"{significant(camera.model_error.sigma_px)} px",
            "1 σ, alike over regions of the image; estimates count it",
        ),
        (
            "Usable to",
            f"{math.degrees(camera.usable_angle):.1f}°",
            f"from the axis; outermost corner at {math.degrees(found.coverage.largest_angle):.1f}°",
        ),
    ]


def _parameters(result: ImageCalibration) -> Markup:
    found = result.calibration
    rows = [
        [name, value, deviation, "yes" if found.identifiable.get(name) else "no"]
        for name, value, deviation in spelled_parameters(found)
    ]
    return table(
        ["parameter", "value", "standard deviation", "known to 1% (centre, distortion: of the image)"], rows
    )


def _what_is_left(result: ImageCalibration) -> str:
    cause = "the lens model lacks something, or the board is not flat; where, is drawn below"
    return agreement_in_words(view_residuals(result).values(), cause)


def _words(result: ImageCalibration) -> Markup:
    found = result.calibration
    lines = [line for line in found.report().splitlines()[2:] if not line.startswith("view ")]
    if result.mirrored:
        lines.append("The camera looks into a mirror: fy (and p1) of the file have the opposite sign.")
    return tag("ul", *(tag("li", line) for line in lines))


def _images(result: ImageCalibration) -> Markup:
    seen, reasons = view_residuals(result), result.not_used()
    dropped = {result.calibrated[k]: rows for k, rows in result.calibration.corners_dropped.items()}
    rows: list[list[str | Markup]] = []
    for i, (image, view) in enumerate(zip(result.images, result.views, strict=True)):
        left = seen[i][1] if i in seen else None
        rms = NOTHING if left is None else significant(float(np.sqrt(np.mean(np.sum(left**2, axis=1)))))
        said = reasons.get(i) or "; ".join(f"corner {row}: {why}" for row, why in dropped.get(i, {}).items())
        mark = tag("span", "no", class_="no") if i in reasons else tag("span", "yes", class_="ok")
        rows.append([image.name, str(len(view)), mark, rms, said])
    return table(["image", "corners found", "used", "rms [px]", "what is not used, and why"], rows)
