"""What was seen: the camera's images, their points, and the robot from outside (figures 2, 5)."""

from __future__ import annotations

import numpy as np
from matplotlib import patheffects
from matplotlib.axes import Axes

from omniservo.geometry.arrays import ByteArray, FloatArray
from omniservo.reporting.around_points import frame_points
from omniservo.reporting.number_places import HEIGHT, number_places
from omniservo.reporting.style import GOAL, START, Drawing, new_figure
from omniservo.results.run_result import RunResult

_PANEL = 245.0
"""width of one of three images side by side [pt]"""


def views(result: RunResult) -> Drawing:
    """Draw the initial, goal and final image of the camera; below each its points, near and numbered."""
    camera = result.task.camera
    figure = new_figure(11.0, 0.5 + 7.4 * camera.height / camera.width)
    panels = figure.subplots(2, 3)
    pictures = (
        ("Initial image", result.seen.initial_image, result.initial_pixels, START),
        ("Goal image, as taught", result.goal.image, result.goal_pixels, GOAL),
        ("Final image", result.final_image, _last_points(result), GOAL),
    )
    for (whole, near), (title, image, points, colour) in zip(panels.T, pictures, strict=True):
        _picture(whole, image, title)
        _picture(near, image, "")
        frame_points(whole, near, points)
        _numbered(near, points, colour)
    return Drawing(
        "views",
        "What the camera on the end-effector saw",
        "Below each image its points, enlarged; equal numbers are the same point, a number without room is "
        "left out. They were found in each image and matched between the first two. The final image should "
        "look like the goal image.",
        figure,
        is_picture=True,
    )


def outside(result: RunResult) -> Drawing | None:
    """Draw the robot and the obstacle at both ends, as a bystander sees them; None on a real robot."""
    if result.outside is None:
        return None
    figure = new_figure(9.6, 3.9)
    left, right = figure.subplots(1, 2)
    _picture(left, result.outside[0], "Start")
    _picture(right, result.outside[1], "End")
    task = result.task
    named = {
        "obstacles (brick red)": task.obstacles,
        "what stands around (wood)": task.surroundings,
        "the target's boards": task.target.boards,
    }
    shown = [name for name, bodies in named.items() if bodies]
    things = " and ".join([", ".join(shown[:-1]), *shown[-1:]] if len(shown) > 1 else shown)
    return Drawing(
        "outside",
        "Robot and obstacle from outside",
        f"The arm with the camera on its end-effector{', ' * bool(things)}{things}, at the start and "
        "at the end of the run.",
        figure,
        is_picture=True,
    )


def _picture(axes: Axes, image: ByteArray, title: str) -> None:
    axes.imshow(
        image, cmap="gray" if image.ndim == 2 else None, vmin=0, vmax=255, interpolation="antialiased"
    )
    axes.set_title(title)
    axes.set_axis_off()


def _numbered(axes: Axes, points: FloatArray, colour: str) -> None:
    """Mark every point with a ring and, where there is room, its number, on any ground legible."""
    halo = [patheffects.withStroke(linewidth=2.2, foreground="white")]
    across = abs(axes.get_xlim()[1] - axes.get_xlim()[0])
    scale = np.array([1.0, -1.0]) * _PANEL / across  # upwards, in points of the page
    axes.plot(*points.T, "o", ms=7, mfc="none", mec=colour, mew=1.2, ls="none")
    for number, place in enumerate(number_places(points * scale)):
        if place is not None:
            u, v = place / scale
            axes.text(
                u, v, str(number), ha="center", va="center", fontsize=HEIGHT, fontweight="bold",
                color=colour, path_effects=halo, clip_on=True,
            )  # fmt: skip


def _last_points(result: RunResult) -> FloatArray:
    """Return the points (n, 2) of the last step; none where the arm was stopped: it moved on a little."""
    ended = result.log.rows and not result.log.stop_reason
    return result.log.rows[-1].pixels if ended else np.empty((0, 2))
