"""What changed during the motion, and what was done then: a figure and a table."""

from __future__ import annotations

from typing import Any

import numpy as np
from scipy.spatial import ConvexHull

from omniservo.geometry.arrays import FloatArray
from omniservo.reporting import promise_words as words
from omniservo.reporting.html import Cell, Markup, joined, table, tag
from omniservo.reporting.space import space_of
from omniservo.reporting.spelling import NOTHING, spell
from omniservo.reporting.style import (
    EXECUTED,
    OBSTACLE,
    PLANNED,
    QUIET,
    REQUIRED,
    SEVEN,
    THREE,
    Drawing,
    legend_below,
    new_figure,
)
from omniservo.reporting.upright_axes import UprightAxes
from omniservo.results.run_result import RunResult

_OUTCOMES = {
    "kept": "the path was still proven: kept",
    "replanned": "switched to another path",
    "blocked": "no continuation was proven: stopped",
}


def replanning(result: RunResult) -> Drawing | None:
    """Draw both paths and the commanded velocities about the change; None where nothing changed."""
    if not result.replannings or not result.log.rows or result.plan is None:
        return None
    figure = new_figure(11.0, 5.2)
    panels = figure.subplot_mosaic([["above", "twist"], ["above", "joints"]], width_ratios=(1.0, 1.15))
    _ways(panels["above"], result)
    time = result.log.column("time")
    twist, joints = result.log.column("twist"), np.rad2deg(result.log.column("joint_velocities"))
    for i, name in enumerate("xyz"):
        panels["twist"].plot(time, 1e3 * twist[:, i], ".-", ms=3, color=THREE[i], lw=1.3, label=name)
    for i in range(joints.shape[1]):
        panels["joints"].plot(
            time, joints[:, i], ".-", ms=3, color=SEVEN[i], lw=1.3, label=f"{i + 1}" if i else "joint 1"
        )
    for axes in (panels["twist"], panels["joints"]):
        _mark(axes, result)
    panels["twist"].set_ylabel("camera [mm/s]")
    panels["joints"].set_ylabel("joints [deg/s]")
    panels["joints"].set_xlabel("time [s]")
    panels["twist"].legend(loc="upper left", ncols=3, fontsize=8)
    low, high = panels["joints"].get_ylim()
    panels["joints"].set_ylim(low, high + 0.25 * (high - low))  # room for the legend
    panels["joints"].legend(loc="upper left", ncols=joints.shape[1], fontsize=8, columnspacing=1.0)
    legend_below(figure, panels["above"], 6)
    return Drawing(
        "replanning",
        "Replanned during the motion",
        "Left, from above: the first plan, the path that was followed, and the obstacle's body before and "
        "after it was moved. Right: the commanded velocities of camera and joints, a dot an image. Dotted "
        "line: something has changed; solid line: another path is followed, from where the reference is "
        "and as fast as it is, so that no velocity jumps.",
        figure,
    )


def replanning_section(result: RunResult) -> Markup | None:
    """Return a table of every change during the motion; None where there was none."""
    if not result.replannings:
        return None
    rows: list[list[Cell]] = []
    for event in result.replannings:
        taken, jump = NOTHING, NOTHING
        if event.leg is not None and result.way is not None:
            jumps = [result.way.jumps(result.way.legs.index(leg)) for leg in event.legs]
            twist, joints = np.max(jumps, axis=0)
            jump = f"{twist:.1e} m/s or rad/s, {joints:.1e} rad/s"
            slower = f", slowed down from {event.legs[0].time:.3f} s on" if len(event.legs) > 1 else ""
            taken = f"{event.leg.time:.3f} s{slower}"
        rows.append(
            [
                f"{event.time:.3f} s",
                event.cause,
                f"{_OUTCOMES[event.outcome]}{': ' if event.reason else ''}{event.reason}",
                spell(event.seconds, "s"),
                taken,
                f"{event.w:.3f}",
                jump,
            ]
        )
    head = ["image at", "what changed", "outcome", "planned in", "switched at", "w", "jump of camera, joints"]
    period = spell(1.0 / result.task.sensor.rate, "s")
    lead = (
        "After every image the rest of the path is proven again for what is known then, camera and arm. "
        "Where that fails another path is planned from where the reference will be in a moment, and until "
        "then the old path is proven, too. Where no continuation is proven the arm brakes. The camera takes "
        f"an image every {period}. The jump is that of the reference; the commands are drawn above."
    )
    return joined([tag("p", lead), table(head, rows)])


def _ways(axes: Any, result: RunResult) -> None:
    upright = UprightAxes.for_start(result.task.start.world_T_camera.transform)
    space = space_of(result, upright)
    for number, faces in enumerate(space.bodies):
        corners = np.vstack(faces)[:, :2]
        outline = corners[ConvexHull(corners).vertices]
        last = number == len(space.bodies) - 1
        axes.fill(
            *outline.T, facecolor=f"{OBSTACLE}55" if last else "none", edgecolor=OBSTACLE, lw=1.0,
            ls="-" if last else "--", label="obstacle after" if last else "before" if number == 0 else None,
        )  # fmt: skip
    first = upright.apply(_first_path(result))
    axes.plot(*first[:, :2].T, color=QUIET, lw=1.6, ls="--", label="first plan")
    if space.planned is not None:
        axes.plot(*space.planned[:, :2].T, color=PLANNED, lw=2.4, label="planned in the end")
    axes.plot(*space.executed[:, :2].T, color=EXECUTED, lw=1.1, label=words.EXECUTED)
    for event in result.replannings:
        if event.leg is not None:
            place = upright.apply(event.leg.path.positions(np.zeros(1)))[0]
            axes.plot(place[0], place[1], "o", ms=7, mfc="white", mec=REQUIRED, label="switched here")
    shown = np.vstack([first, space.executed])[:, :2]
    middle, half = 0.5 * (shown.min(axis=0) + shown.max(axis=0)), 0.75 * float(np.ptp(shown, axis=0).max())
    axes.set(xlim=middle[0] + half * np.array([-1, 1]), ylim=middle[1] + half * np.array([-1, 1]))
    axes.set_aspect("equal")
    axes.set_title("From above")
    upright.name(axes, 0, 1)


def _first_path(result: RunResult) -> FloatArray:
    if result.plan is None or result.plan.path is None:
        raise AssertionError("a change on the way of a run without a plan")
    return result.plan.path.positions(np.linspace(0.0, 1.0, 201))


def _mark(axes: Any, result: RunResult) -> None:
    """Draw when something changed and when another path was followed."""
    for event in result.replannings:
        axes.axvline(event.time, color=OBSTACLE, ls=":", lw=1.4)
        if event.leg is not None:
            axes.axvline(event.leg.time, color=REQUIRED, lw=1.0)
