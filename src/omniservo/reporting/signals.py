"""What the controller saw and commanded over time."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from matplotlib.axes import Axes
from matplotlib.ticker import FuncFormatter, LogFormatter

from omniservo.geometry.arrays import FloatArray
from omniservo.reporting.style import (
    EXECUTED,
    PLANNED,
    REQUIRED,
    SEVEN,
    THREE,
    Drawing,
    legend_below,
    new_axes,
    new_figure,
)
from omniservo.results.run_result import RunResult
from omniservo.scenes.scene_of_task import scene_of_task

_LEAST_PX = 1e-3
"""What lies below is drawn here: a logarithmic axis has no zero [px]."""


def image_error(result: RunResult) -> Drawing | None:
    """Draw the points' distance to the reference and to the goal image over time; None without a step."""
    log = result.log
    if not log.rows:
        return None
    time = log.column("time")
    figure, axes = new_axes(5.8, 3.8)
    axes.plot(time, _above_zero(log.column("goal_error_px")), color=EXECUTED, label="to the goal image")
    if result.plan is not None:
        axes.plot(
            time, _above_zero(log.column("error_px")), color=PLANNED, lw=1.4, label="to the path's reference"
        )
    tolerance = result.task.servo.tolerance_px
    axes.axhline(tolerance, color=REQUIRED, ls=":", lw=1.6, label=f"tolerance: {tolerance:g} px")
    axes.set_yscale("log")
    axes.yaxis.set_major_formatter(FuncFormatter(lambda value, _: f"{value:g}"))
    axes.yaxis.set_minor_formatter(LogFormatter())
    axes.set_xlabel("time [s]")
    axes.set_ylabel("rms distance of the points [px]")
    legend_below(figure, axes, 3)
    return Drawing(
        "image-error",
        "Error in the image",
        "Logarithmic. The distance to the goal image must end below the tolerance; the distance to the "
        "moving reference says how closely the arm follows the plan.",
        figure,
    )


def camera_twist(result: RunResult) -> Drawing | None:
    """Draw the commanded twist of the camera over time; None without a step."""
    if not result.log.rows:
        return None
    time, twist = result.log.column("time"), result.log.column("twist")
    figure = new_figure(5.8, 4.2)
    upper, lower = figure.subplots(2, 1, sharex=True)
    _components(upper, time, twist[:, :3], THREE, ("x", "y", "z"))
    _components(lower, time, np.rad2deg(twist[:, 3:]), THREE, ("x", "y", "z"))
    upper.set_ylabel("linear [m/s]")
    lower.set_ylabel("angular [deg/s]")
    lower.set_xlabel("time [s]")
    legend_below(figure, upper, 3)
    return Drawing(
        "camera-twist",
        "Commanded twist of the camera",
        "Linear and angular velocity in the camera's own axes. A rest-to-rest motion starts and ends at zero "
        "without a jump.",
        figure,
    )


def joint_velocities(result: RunResult) -> Drawing | None:
    """Draw the commanded joint velocities over time; None without a step."""
    if not result.log.rows:
        return None
    time = result.log.column("time")
    velocities = np.rad2deg(result.log.column("joint_velocities"))
    arm = scene_of_task(result.task).arm
    limits = np.rad2deg(arm.joint_speed)
    figure, axes = new_axes(5.8, 3.8)
    names = [f"{name} (at most {limit:.0f})" for name, limit in zip(arm.joint_names, limits, strict=True)]
    _components(axes, time, velocities, SEVEN[: len(names)], names)
    axes.set_xlabel("time [s]")
    axes.set_ylabel("joint velocity [deg/s]")
    legend_below(figure, axes, 3)
    share = float(np.max(np.abs(velocities) / limits))
    return Drawing(
        "joint-velocities",
        "Commanded joint velocities",
        f"In brackets what each joint can do [deg/s]. The highest command here is {share:.0%} of its joint's "
        "limit.",
        figure,
    )


def _components(
    axes: Axes,
    time: FloatArray,
    values: FloatArray,
    colours: Sequence[str],
    names: Sequence[str],
) -> None:
    marker = "." if len(time) == 1 else ""
    for column, colour, name in zip(values.T, colours, names, strict=True):
        axes.plot(time, column, color=colour, lw=1.5, marker=marker, label=name)


def _above_zero(values: FloatArray) -> FloatArray:
    """Return values that a logarithmic axis can show; NaN stays a gap."""
    return np.maximum(values, _LEAST_PX)
