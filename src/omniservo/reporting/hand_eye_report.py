"""The HTML report of a hand-eye calibration: one file that needs nothing else."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np

from omniservo.calibration.hand_eye import HandEye, ImageHandEye
from omniservo.files import write_whole
from omniservo.geometry.arrays import FloatArray
from omniservo.reporting.framed_figure import framed
from omniservo.reporting.hand_eye_figures import hand_eye_drawings
from omniservo.reporting.html import Markup, banner, judged, page, part, table, tag, tiles
from omniservo.reporting.spelling import NOTHING, significant, spell


def write_hand_eye_report(found: ImageHandEye, path: str | Path, *, force: bool = False) -> None:
    """Write the report; it holds its figures.

    Raises:
        InputError: the file exists and ``force`` is False, or it cannot be written.
    """
    write_whole(path, hand_eye_html(found), force=force)


def hand_eye_html(found: ImageHandEye) -> str:
    """Return the report's text."""
    result = found.result
    known = result.status == "ok"
    good = known and not result.board_size_disputed
    words = f"{len(result.used)} of {len(found.images)} images used" if known else result.message
    body = [
        banner("Hand-eye calibration", f"{len(found.images)} robot poses, one image each"),
        judged(good, tag("strong", _verdict(result)), tag("p", words)),
    ]
    if known:
        figures = tag("div", *(framed(d, "half") for d in hand_eye_drawings(found)), class_="figures")
        body += [
            tiles(_numbers(result)),
            part("The camera in the flange's frame", _pose(result), _board_size(result)),
            part("Figures", figures),
        ]
    body.append(part("Images", _images(found)))
    return page("hand-eye calibration", body)


def _verdict(result: HandEye) -> str:
    if result.status != "ok":
        return f"No pose: {result.status}"
    return "The board's size is disputed" if result.board_size_disputed else "Calibrated"


def _numbers(result: HandEye) -> list[tuple[str, str, str]]:
    sigma = _half_axes(result.covariance)
    worst = result.scatter_worst
    return [
        (
            "The camera is right within",
            f"{spell(sigma[0], 'm')}, {spell(sigma[1], 'rad')}",
            "largest standard deviation of a direction; the robot's own errors are in it",
        ),
        (
            "The board by one view alone",
            f"{spell(worst[0], 'm')}, {spell(worst[1], 'rad')}",
            "worst view, from where all views together put it",
        ),
        (
            "The robot's poses are off by",
            f"{spell(result.robot_position_m, 'm')}, {spell(result.robot_rotation_rad, 'rad')}",
            "standard deviation per axis, from the views",
        ),
        ("Corners", f"{significant(result.noise_px)} px", "standard deviation of a coordinate"),
    ]


def _half_axes(covariance: FloatArray) -> tuple[float, float]:
    """Largest standard deviation of a direction: [m], [rad]."""
    values = [math.sqrt(np.linalg.eigvalsh(covariance[k : k + 3, k : k + 3])[-1]) for k in (0, 3)]
    return values[0], values[1]


def _pose(result: HandEye) -> Markup:
    if result.flange_T_camera is None:
        return Markup("")
    sigma = np.sqrt(np.diag(result.covariance))
    turn = result.flange_T_camera.rotation.as_rotvec(degrees=True)
    rows = [
        [f"translation {axis}", _signed(1e3 * value, " mm"), f"± {significant(1e3 * s)} mm"]
        for axis, value, s in zip("xyz", result.flange_T_camera.translation, sigma[:3], strict=True)
    ]
    rows += [
        [
            f"rotation vector {axis}",
            _signed(value, "°"),
            f"± {significant(math.degrees(s))}° about the camera's {axis}",
        ]
        for axis, value, s in zip("xyz", turn, sigma[3:], strict=True)
    ]
    return table(["flange_T_camera", "value", "standard deviation"], rows)


def _board_size(result: HandEye) -> Markup:
    words = (
        f"By the robot's lengths the board is {result.board_scale:.4f} ± {result.board_scale_sigma:.4f} "
        "times as large as stated"
    )
    if not result.board_size_disputed:
        return tag("p", f"{words}: both agree.")
    reach = "The standard deviations above reach to the pose that this size would give."
    return tag("p", tag("strong", f"{words}: measure its squares. "), reach)


def _images(found: ImageHandEye) -> Markup:
    rows: list[list[str | Markup]] = []
    for image, view in zip(found.images, found.result.views, strict=True):
        mark = tag("span", "yes", class_="ok") if view.used else tag("span", "no", class_="no")
        rms = [NOTHING if math.isnan(px) else significant(px) for px in (view.own_rms_px, view.loop_rms_px)]
        off = [spell(view.position_m, "m"), spell(view.rotation_rad, "rad")]
        rows.append([image.name, str(view.corners), mark, *off, *rms, view.reason])
    head = [
        "image",
        "corners",
        "used",
        "board off by",
        "turned by",
        "own rms [px]",
        "loop rms [px]",
        "reason",
    ]
    return table(head, rows)


def _signed(value: float, unit: str) -> str:
    return f"{value:.3f}{unit}".replace("-", "−")
