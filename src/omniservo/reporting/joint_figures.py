"""The planned joints over w within their ranges, and their speeds over time within what the arm can do."""

from __future__ import annotations

import numpy as np
from matplotlib.axes import Axes

from omniservo.geometry.arrays import FloatArray
from omniservo.reporting import promise_words as words
from omniservo.reporting.style import FORBIDDEN, QUIET, SEVEN, Drawing, legend_below, new_axes
from omniservo.results.run_log import RunLog
from omniservo.results.run_result import RunResult
from omniservo.tracking.planned_motion import PlannedMotion

_TICK = 5e-3
"""[s]"""


def joint_positions(result: RunResult) -> Drawing | None:
    """Draw the planned joints over w, each relative to its range; None without a plan."""
    if result.motion is None:
        return None
    motion, w = result.motion, np.linspace(0.0, 1.0, 401)
    low, high = motion.arm.joint_range.T
    share = (2.0 * motion.joints(w) - low - high) / (high - low)
    figure, axes = new_axes(5.8, 3.8)
    for i, name in enumerate(motion.arm.joint_names):
        span = f"{np.rad2deg(low[i]):.0f} … {np.rad2deg(high[i]):.0f}"
        axes.plot(w, 100.0 * share[:, i], color=SEVEN[i], label=f"{name} ({span})".replace("-", "−"))
    axes.set(xlim=(0.0, 1.0), ylim=(-110.0, 110.0), xlabel="path parameter w [1]")
    axes.set_ylabel("distance from the middle of the\nrange, of half the range [%]")
    for side in (-1.0, 1.0):
        axes.axhspan(100.0 * side, 110.0 * side, color=FORBIDDEN, lw=0)
        axes.axhline(100.0 * side, color=QUIET, lw=1.0)
    legend_below(figure, axes, 3)
    return Drawing(
        "joint-positions",
        "Planned joints within their ranges",
        "0 is the middle of a joint's range, ±100% its ends; in brackets the range [deg]. No curve may reach "
        "the tinted strips.",
        figure,
    )


def joint_speeds(result: RunResult) -> Drawing | None:
    """Draw planned and executed joint speeds over time as shares of the arm's; None without a plan."""
    if result.motion is None or result.way is None:
        return None
    motion = result.motion
    end = max(motion.seconds, result.way.seconds)
    times = np.arange(0.0, end + _TICK, _TICK)
    planned = 100.0 * np.abs(result.way.speeds_at(times)) / motion.arm.joint_speed
    figure, axes = new_axes(5.8, 3.8)
    for i, name in enumerate(motion.arm.joint_names):
        axes.plot(times, planned[:, i], color=SEVEN[i], lw=1.5, label=name)
    top = max(float(planned.max()), _executed(axes, result.log, motion), 1.0)
    axes.set(xlabel="time [s]", ylabel="joint speed, of its limit [%]", ylim=(0.0, 1.12 * top))
    axes.plot([], [], "o", color=QUIET, ms=2.5, label=words.EXECUTED)
    legend_below(figure, axes, 4)
    return Drawing(
        "joint-speeds",
        "Joint speeds, planned and executed",
        "Share of what each joint can do. Lines: as planned. Dots: as executed, from image to image.",
        figure,
    )


def executed_speed_shares(log: RunLog, motion: PlannedMotion) -> tuple[FloatArray, FloatArray]:
    """Return times (k,) [s] between readings of joints, and their mean speeds there over the arm's (k, n)."""
    if len(log.rows) < 2:
        return np.empty(0), np.empty((0, motion.arm.dof))
    time, newer = np.unique(log.column("read_time"), return_index=True)
    shares = np.abs(np.diff(log.column("joints")[newer], axis=0)) / np.diff(time)[:, None]
    return 0.5 * (time[1:] + time[:-1]), shares / motion.arm.joint_speed


def _executed(axes: Axes, log: RunLog, motion: PlannedMotion) -> float:
    """Draw the executed speeds; return the largest [%]."""
    time, shares = executed_speed_shares(log, motion)
    for i in range(motion.arm.dof):
        axes.plot(time, 100.0 * shares[:, i], "o", color=SEVEN[i], ms=2.0)
    return float(100.0 * shares.max(initial=0.0))
