"""Every link's distance to what stands around, over time."""

from __future__ import annotations

import matplotlib as mpl

from omniservo.reporting import promise_words
from omniservo.reporting.style import CERTIFIED, FORBIDDEN, REQUIRED, Drawing, legend_below, new_axes
from omniservo.results.run_result import RunResult
from omniservo.robots import FARTHEST
from omniservo.tasks.obstacles import CloudSection


def link_clearance(result: RunResult) -> Drawing | None:
    """Draw each link's gap over time, planned and executed; None where no link comes near anything."""
    whole = result.whole_arm
    if whole is None or not result.log.rows:
        return None
    near = [link for link, gaps in whole.executed.items() if gaps.min() < FARTHEST]
    if not near:
        return None
    time, read = result.log.column("time"), result.log.column("read_time")
    figure, axes = new_axes(5.8, 4.2)
    colours = mpl.colormaps["viridis"](range(0, 256, max(1, 230 // max(1, len(near) - 1))))
    for link, colour in zip(near, colours, strict=False):
        axes.plot(time, 1e3 * whole.planned[link], color=colour, lw=1.2, ls="--")
        axes.plot(read, 1e3 * whole.executed[link], color=colour, lw=1.8, label=link.replace("_", " "))
    if whole.asked is not None:
        axes.axhline(1e3 * whole.asked, color=REQUIRED, ls=":", lw=1.6, label=promise_words.REQUIRED)
        if whole.proof.status == "clear":
            axes.axhline(
                1e3 * whole.proof.clearance, color=CERTIFIED, ls="--", lw=1.6, label=promise_words.CERTIFIED
            )
    low = min(0.0, axes.get_ylim()[0])
    axes.set_ylim(low, min(1e3 * FARTHEST, axes.get_ylim()[1]))
    if low < 0.0:
        axes.axhspan(low, 0.0, color=FORBIDDEN, zorder=0)
    axes.set_xlabel("time [s]")
    axes.set_ylabel("link to the nearest body [mm]")
    legend_below(figure, axes, 3)
    things = "the nearest of the obstacles that the planner knows and the floor"
    if whole.asked is None:
        things = "the floor; the task's obstacles are points that stand for bodies already"
    elif any(isinstance(section, CloudSection) for section in result.task.planning.obstacles):
        things += " (of a cloud: the boxes that hold its balls)"
    return Drawing(
        "link-clearance",
        "Distance of every link",
        f"Each link, and the camera's housing, to {things}, up to {1e3 * FARTHEST:g} mm. Solid: the joints "
        f"as they were read; dashed: as planned there.{''.join(f' Notice: {n}.' for n in whole.notices)}",
        figure,
    )
