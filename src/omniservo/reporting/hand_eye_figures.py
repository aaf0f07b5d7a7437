"""What a hand-eye calibration rests on, drawn: what is left in each view, in the image and at the board."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from matplotlib.patches import Rectangle

from omniservo.calibration.hand_eye import ImageHandEye
from omniservo.reporting.spelling import first_digit
from omniservo.reporting.style import (
    EXECUTED,
    PLANNED,
    QUIET,
    REQUIRED,
    SEVEN,
    Drawing,
    as_image,
    legend_below,
    new_axes,
    new_figure,
    styled,
)


def hand_eye_drawings(found: ImageHandEye) -> Iterator[Drawing]:
    """Yield the figures of a hand-eye calibration; none where there is no pose."""
    if found.result.status != "ok":
        return
    for draw in (_scatter, _pixels, _corners):
        with styled():
            yield draw(found)


def _scatter(found: ImageHandEye) -> Drawing:
    """Position and rotation of each view's own board, off base_T_board."""
    used, views = found.result.used, found.result.views
    figure = new_figure(max(6.4, 1.6 + 0.3 * len(used)), 4.6)
    upper, lower = figure.subplots(2, 1, sharex=True)
    places = np.arange(len(used))
    upper.bar(places, [1e3 * views[i].position_m for i in used], color=EXECUTED, width=0.7)
    lower.bar(places, [np.degrees(views[i].rotation_rad) for i in used], color=EXECUTED, width=0.7)
    upper.set_ylabel("position [mm]")
    lower.set_ylabel("rotation [deg]")
    for axes in (upper, lower):
        axes.grid(visible=False, axis="x")
    lower.set_xticks(places, [found.images[i].stem for i in used], rotation=60, ha="right", fontsize=8)
    caption = "How far each used view alone puts the board from where all of them put it."
    return Drawing("board-scatter", "The board by each view alone", caption, figure)


def _pixels(found: ImageHandEye) -> Drawing:
    """Root mean square of the corners: own pose, and through the loop."""
    used, views = found.result.used, found.result.views
    figure, axes = new_axes(max(6.4, 1.6 + 0.3 * len(used)), 3.8)
    places = np.arange(len(used))
    axes.bar(places - 0.2, [views[i].own_rms_px for i in used], 0.4, color=QUIET, label="view's own pose")
    axes.bar(places + 0.2, [views[i].loop_rms_px for i in used], 0.4, color=PLANNED, label="robot's pose")
    axes.set_xticks(places, [found.images[i].stem for i in used], rotation=60, ha="right", fontsize=8)
    axes.grid(visible=False, axis="x")
    axes.set_ylabel("root mean square [px]")
    legend_below(figure, axes, 2)
    caption = (
        "Grey: what corners and camera leave, the board's pose being free in each view. Orange: what the "
        "robot's pose, flange_T_camera and base_T_board leave together."
    )
    return Drawing("view-residuals", "What is left in each view", caption, figure)


def _corners(found: ImageHandEye) -> Drawing:
    """Loop residuals over the image, a colour a view."""
    camera = found.camera
    figure, axes = new_axes(6.4, 1.0 + 5.6 * camera.height / camera.width)
    axes.add_patch(Rectangle((-0.5, -0.5), camera.width, camera.height, fill=False, ec=REQUIRED, lw=1.2))
    used = found.result.used
    longest = max(float(np.hypot(*found.result.views[i].loop_px.T).max()) for i in used)
    scale = first_digit(0.06 * camera.width / max(longest, 1e-9))
    for place, i in enumerate(used):
        view, colour = found.result.views[i], SEVEN[place % len(SEVEN)]
        arrows = scale * view.loop_px
        axes.quiver(*view.pixels.T, *arrows.T, angles="xy", scale_units="xy", scale=1.0, width=0.0018,
                    color=colour)  # fmt: skip
    as_image(axes, camera.width, camera.height)
    caption = (
        f"Where the robot's pose puts corners, minus the corners, {scale:g} times as long; a colour for "
        "each view. Arrows of a view that agree are the robot's error at that pose."
    )
    return Drawing("loop-residuals", "What is left over the image", caption, figure)
