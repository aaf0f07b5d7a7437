"""The features' trajectories on the virtual plane and in the image (figures 3b, 3c and 6b, 6c)."""

from __future__ import annotations

import numpy as np
from matplotlib.axes import Axes
from matplotlib.patches import Circle, Polygon, Rectangle

from omniservo.cameras.models import CentralModel
from omniservo.geometry.arrays import FloatArray
from omniservo.reporting.curves import Curve, executed_curve, planned_curve
from omniservo.reporting.style import (
    EXECUTED,
    FORBIDDEN,
    GOAL,
    PLANNED,
    QUIET,
    START,
    Drawing,
    as_image,
    legend_below,
    new_axes,
)
from omniservo.results.run_result import RunResult


def plane_trajectories(result: RunResult) -> Drawing:
    """Draw the features' trajectories on the virtual plane Z = 1."""
    figure, axes = new_axes(5.8, 4.6)
    planned, executed = planned_curve(result), executed_curve(result)
    _ways(axes, None if planned is None else planned.plane, executed.plane)
    camera = result.task.camera
    _ends(axes, _on_plane(camera, result.initial_pixels), _on_plane(camera, result.goal_pixels))
    axes.set_aspect("equal", adjustable="datalim")
    axes.invert_yaxis()
    axes.set_xlabel("X / Z [1]")
    axes.set_ylabel("Y / Z [1]")
    legend_below(figure, axes, 4)
    return Drawing(
        "virtual-plane",
        "Feature trajectories on the virtual plane",
        "Red circles: where the points start; blue stars: where the goal image has them. "
        + _left_out(executed),
        figure,
    )


def image_trajectories(result: RunResult) -> Drawing:
    """Draw the features' trajectories in the image, over its border, the lens's circle and the dead zone."""
    camera = result.task.camera
    figure, axes = new_axes(5.8, 0.9 + 5.2 * camera.height / camera.width)
    _image_limits(axes, camera)
    planned, executed = planned_curve(result), executed_curve(result)
    _ways(axes, None if planned is None else planned.pixels, executed.pixels)
    _ends(axes, result.initial_pixels, result.goal_pixels)
    as_image(axes, camera.width, camera.height)
    legend_below(figure, axes, 4)
    return Drawing(
        "image",
        "Feature trajectories in the image",
        "Red circles: where the points start; blue stars: where the goal image has them. No trajectory may "
        "touch the tinted area: outside the image, beyond the lens's circle, or in a dead zone.",
        figure,
    )


def _ways(axes: Axes, planned: FloatArray | None, executed: FloatArray) -> None:
    """Draw trajectories (k, n, 2): executed thick, planned thin above it."""
    for j in range(executed.shape[1]):
        label = "executed, as detected" if j == 0 else None
        axes.plot(*executed[:, j].T, color=EXECUTED, lw=2.6, alpha=0.9, label=label, solid_capstyle="round")
    if planned is None:
        return
    for j in range(planned.shape[1]):
        axes.plot(*planned[:, j].T, color=PLANNED, lw=1.1, label="planned" if j == 0 else None)


def _ends(axes: Axes, start: FloatArray, goal: FloatArray) -> None:
    axes.plot(*start.T, "o", ms=8, mfc="none", mec=START, mew=1.6, ls="none", label="start")
    axes.plot(*goal.T, "*", ms=9, mfc=GOAL, mec="white", mew=0.6, ls="none", label="goal", zorder=4)


def _image_limits(axes: Axes, camera: CentralModel) -> None:
    axes.set_facecolor(FORBIDDEN)
    border = Rectangle((-0.5, -0.5), camera.width, camera.height, facecolor="white", edgecolor="none")
    axes.add_patch(border)
    circle = _lens_circle(camera)
    if circle is not None:
        axes.add_patch(Rectangle((-0.5, -0.5), camera.width, camera.height, facecolor=FORBIDDEN, ec="none"))
        (disc,) = axes.fill(*circle.T, facecolor="white", edgecolor=QUIET, lw=1.0, ls=(0, (5, 3)))
        disc.set_clip_path(border)
    axes.add_patch(Rectangle((-0.5, -0.5), camera.width, camera.height, fill=False, edgecolor=QUIET, lw=1.4))
    if camera.dead_zone is not None:
        zone = camera.dead_zone
        axes.add_patch(Circle(zone.center, zone.radius, facecolor=FORBIDDEN, edgecolor=QUIET, lw=1.0))
    for corners in camera.mask:
        axes.add_patch(Polygon(corners, facecolor=FORBIDDEN, edgecolor=QUIET, lw=1.0))


def _lens_circle(camera: CentralModel) -> FloatArray | None:
    """Return the image (k, 2) [px] of the largest angle, a hair inside; None where the camera states none."""
    if camera.max_angle is None:
        return None
    around = np.linspace(0.0, 2.0 * np.pi, 361)
    angle = camera.usable_angle - 1e-7
    across = np.sin(angle) * np.stack([np.cos(around), np.sin(around)], axis=1)
    pixels, valid = camera.project(np.column_stack([across, np.full(len(around), np.cos(angle))]))
    return np.asarray(pixels[valid], dtype=np.float64)


def _on_plane(camera: CentralModel, pixels: FloatArray) -> FloatArray:
    bearings, valid = camera.unproject(pixels)
    seen = valid & (bearings[..., 2] > 0.0)
    return np.asarray(bearings[seen, :2] / bearings[seen, 2:], dtype=np.float64)


def _left_out(executed: Curve) -> str:
    """Say how many points the virtual plane cannot show."""
    every = executed.pixels.shape[0] * executed.pixels.shape[1]
    if executed.points_left_out == 0:
        return "The virtual plane ends at 90° from the optical axis; here every point seen is inside it."
    return (
        f"The virtual plane ends at 90° from the optical axis: {executed.points_left_out} of {every} "
        "detections lie beyond it and are left out."
    )
