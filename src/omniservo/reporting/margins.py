"""Distance to the obstacles and to the image's limits: planned, guaranteed, executed."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from matplotlib.axes import Axes

from omniservo.geometry.arrays import FloatArray
from omniservo.planning import Plan
from omniservo.reporting import promise_words
from omniservo.reporting.curves import Curve, executed_curve, planned_curve
from omniservo.reporting.style import (
    CERTIFIED,
    EXECUTED,
    FORBIDDEN,
    PLANNED,
    QUIET,
    REQUIRED,
    Drawing,
    legend_below,
    new_axes,
)
from omniservo.results.run_result import RunResult


def clearance(result: RunResult) -> Drawing | None:
    """Draw the camera's distance to the planner's obstacles; None where there are none."""
    obstacles = result.task.planning.obstacles
    if not obstacles:
        return None
    planned, executed = planned_curve(result), executed_curve(result)
    common = result.task.planning.common_obstacles
    own = [i for i, o in enumerate(obstacles) if o.clearance is not None]
    figure, axes = new_axes(5.8, 3.9)
    _group(axes, planned, executed, own, (QUIET, QUIET), "with a clearance of their own")
    _group(axes, planned, executed, common, (PLANNED, EXECUTED), "")
    _asked_lines(axes, result, common)
    certified = certified_clearance(result)
    if certified is not None and common:
        axes.axhline(
            1000.0 * certified, color=CERTIFIED, ls=(0, (5, 2)), lw=2.0, label=promise_words.CERTIFIED
        )
    _along(axes, planned)
    axes.set_ylim(bottom=min(0.0, axes.get_ylim()[0]))
    axes.set_ylabel("camera centre to surface [mm]")
    legend_below(figure, axes, 2)
    return Drawing(
        "clearance",
        "Distance to the obstacles",
        "One curve for each obstacle that the planner knows. The planned path must stay above the certified "
        "bound (red), what was executed above what the task requires (dotted). The path has to keep more "
        "than is required, because the arm deviates from it.",
        figure,
    )


def visibility(result: RunResult) -> Drawing:
    """Draw the smallest distance of any dot to the image's limits."""
    planned, executed = planned_curve(result), executed_curve(result)
    figure, axes = new_axes(5.8, 3.9)
    if planned is not None:
        axes.plot(planned.w, planned.visibility, color=PLANNED, label="planned")
    x = _abscissa(executed, planned)
    axes.plot(
        x,
        executed.visibility,
        "." if planned is not None else ".-",
        lw=0.8,
        ms=5,
        color=EXECUTED,
        label=promise_words.EXECUTED,
    )
    axes.axhline(
        result.task.planning.visibility_margin, color=REQUIRED, ls=":", lw=1.6, label=promise_words.REQUIRED
    )
    certified = certified_visibility(result)
    if certified is not None:
        axes.axhline(certified, color=CERTIFIED, ls=(0, (5, 2)), lw=2.0, label=promise_words.CERTIFIED)
    _along(axes, planned)
    low = min(0.0, axes.get_ylim()[0])
    axes.set_ylim(bottom=low)
    if low < 0.0:
        axes.axhspan(low, 0.0, color=FORBIDDEN, zorder=0)
    axes.set_ylabel("nearest point to an image limit [px]")
    legend_below(figure, axes, 2)
    return Drawing(
        "visibility",
        "Points in view",
        "Distance of the worst point to the nearest limit: image border, lens's circle, dead zone. Above "
        "zero every point is in view. A gap is a point that the camera cannot see at all.",
        figure,
    )


def arm_gap(result: RunResult) -> Drawing | None:
    """Draw the gap between the arm and the obstacles' bodies over time; None without a step or a body."""
    if not result.log.rows or result.truth is None or not result.truth.obstacle_corners:
        return None
    figure, axes = new_axes(5.8, 3.8)
    gap = 1000.0 * result.log.column("arm_clearance")
    axes.plot(
        result.log.column("time"), gap, ".-", ms=3, lw=1.5, color=EXECUTED, label=promise_words.EXECUTED
    )
    low = min(0.0, axes.get_ylim()[0])
    axes.set_ylim(bottom=low)
    axes.axhline(0.0, color=CERTIFIED, lw=1.2, label="contact")
    if low < 0.0:
        axes.axhspan(low, 0.0, color=FORBIDDEN, zorder=0)
    axes.set_xlabel("time [s]")
    axes.set_ylabel("any link to any body [mm]")
    legend_below(figure, axes, 2)
    return Drawing(
        "arm-gap",
        "Gap between arm and obstacle",
        "The smallest gap between any link, or the camera's body, and the obstacle's real body, which the "
        "planner need not know. Measured, not promised. Below zero: contact.",
        figure,
    )


def certified_clearance(result: RunResult) -> float | None:
    """Return the guaranteed smallest distance [m] to the obstacles without a clearance of their own."""
    common = result.task.planning.common_obstacles
    kept = [plan.least_clearance(common) for plan in _certified_plans(result)]
    return min((value for value in kept if value is not None), default=None)


def certified_visibility(result: RunResult) -> float | None:
    """Return the guaranteed smallest distance [px] of any dot to an image limit."""
    kept = [plan.least_visibility() for plan in _certified_plans(result)]
    return min((value for value in kept if value is not None), default=None)


def _certified_plans(result: RunResult) -> list[Plan]:
    """Return the plans that were followed; none where the first was not certified."""
    if result.plan is None or result.plan.status != "certified":
        return []
    return [result.plan, *(event.plan for event in result.replannings if event.plan is not None)]


def _group(
    axes: Axes,
    planned: Curve | None,
    executed: Curve,
    chosen: Sequence[int],
    colours: tuple[str, str],
    note: str,
) -> None:
    """Draw the distances to some of the obstacles."""
    x, style = _abscissa(executed, planned), "." if planned is not None else ".-"
    for number, i in enumerate(chosen):
        label = note or None if number == 0 else None
        if planned is not None:
            axes.plot(
                planned.w, 1000.0 * planned.clearances[:, i], color=colours[0], lw=1.8 if not note else 1.0,
                label=(label or "planned") if number == 0 else None,
            )  # fmt: skip
        if not note or planned is None:
            axes.plot(
                x, 1000.0 * executed.clearances[:, i], style, lw=0.8, ms=4, color=colours[1],
                label=(label or promise_words.EXECUTED) if number == 0 else None,
            )  # fmt: skip


def _asked_lines(axes: Axes, result: RunResult, common: Sequence[int]) -> None:
    planning = result.task.planning
    if not common:
        return
    asked = 1000.0 * planning.clearance
    axes.axhline(asked, color=REQUIRED, ls=":", lw=1.8, label=f"{promise_words.REQUIRED}: {asked:g} mm")
    if planning.tracking_margin > 0.0 and result.plan is not None:
        wider = 1000.0 * (planning.clearance + planning.tracking_margin)
        axes.axhline(
            wider, color=QUIET, ls=(0, (8, 3, 1, 3)), lw=1.4, label=f"to be kept by the path: {wider:g} mm"
        )


def _abscissa(executed: Curve, planned: Curve | None) -> FloatArray:
    """Return w of the executed steps, or the time where nothing was planned."""
    return executed.time if planned is None else executed.w


def _along(axes: Axes, planned: Curve | None) -> None:
    if planned is None:
        axes.set_xlabel("time [s] (nothing was planned)")
    else:
        axes.set_xlabel("path parameter w [1]")
        axes.set_xlim(-0.01, 1.01)
        axes.set_xticks(np.linspace(0.0, 1.0, 6))
