"""The camera's path in space (figures 3a and 6a)."""

from __future__ import annotations

from typing import Any

import numpy as np
from matplotlib.patches import Polygon
from matplotlib.ticker import MaxNLocator
from mpl_toolkits.mplot3d.art3d import Poly3DCollection  # type: ignore[import-untyped]
from scipy.spatial import ConvexHull

from omniservo.geometry.arrays import FloatArray
from omniservo.reporting import promise_words as words
from omniservo.reporting.space import Space, space_of
from omniservo.reporting.style import EXECUTED, OBSTACLE, PLANNED, QUIET, Drawing, legend_below, new_figure
from omniservo.reporting.upright_axes import UprightAxes
from omniservo.results.run_result import RunResult
from omniservo.tasks.obstacles import CloudSection, SphereSection

_FLAT = 4.3
"""width of a flat panel [inch]"""


def path_3d(result: RunResult) -> Drawing:
    """Draw planned and executed path, camera symbols, estimated points, obstacles and their safe distance."""
    upright = UprightAxes.for_start(result.task.start.world_T_camera.transform)
    space = space_of(result, upright)
    ahead, aside, up = (space.view[1] - space.view[0]).tolist()
    tall = _FLAT * (aside + up) / ahead
    figure = new_figure(11.0, min(max(tall + 2.0, 5.2), 9.0))
    panels = figure.subplot_mosaic(
        [["askew", "side"], ["askew", "above"]],
        per_subplot_kw={"askew": {"projection": "3d"}},
        width_ratios=(1.0, 1.0),
        height_ratios=(up, aside),
    )
    _askew(panels["askew"], space, upright)
    panels["above"].sharex(panels["side"])
    for name, columns, title in (("above", (0, 1), "From above"), ("side", (0, 2), "From the side")):
        _flat(panels[name], space, columns)
        panels[name].set_title(title)
        upright.name(panels[name], *columns)
    panels["side"].set_xlabel("")
    panels["side"].tick_params(labelbottom=False)
    legend_below(figure, panels["side"], 4 if any(r.has_own_clearance for r in space.keep_out) else 6)
    return Drawing(
        "path-3d",
        "Path of the camera in space",
        "In the initial camera frame, drawn upright with equal axis scaling. "
        f"{_obstacles_in_words(result)}Small pyramids: the camera, looking through its base. What is "
        "far from path and target is cut off.",
        figure,
        is_picture=True,
    )


def _obstacles_in_words(result: RunResult) -> str:
    """Say what is shaded, and whether the planner was given bodies or only balls that stand for them."""
    task, given = result.task, result.task.planning.obstacles
    if not given:
        return ""
    alone = all(isinstance(section, SphereSection | CloudSection) for section in given)
    by_what = "for which these points or balls stand" if alone else "which is stated as a body"
    drawn = result.truth is not None
    body = f"The brick-red box is the obstacle's real body, {by_what}. " if drawn else ""
    shaded = (
        "Shaded: the safe distance that the task requires around what the planner is given of the obstacle "
        "(crosses); the path must stay outside. "
    )
    clouds = [section for section in given if isinstance(section, CloudSection)]
    if not clouds:
        return shaded + body
    dotted = "Dots: points of clouds that the planner is given, some of them; the path keeps away from all. "
    return (shaded if len(clouds) < len(given) else "") + dotted + (body if task.obstacles else "")


def _askew(axes: Any, space: Space, upright: UprightAxes) -> None:
    """Draw everything in perspective-free 3-D."""
    axes.set_proj_type("ortho")
    axes.view_init(elev=24.0, azim=-58.0)
    _solid(axes, space)
    for line in space.symbols:
        axes.plot(*line.T, color=EXECUTED, lw=0.9, alpha=0.75)
    axes.plot(*space.executed.T, color=EXECUTED, lw=3.2, zorder=5)
    if space.planned is not None:
        axes.plot(*space.planned.T, color=PLANNED, lw=1.4, zorder=6)
    axes.scatter(*space.points.T, s=18, c="black", depthshade=False)
    low, high = space.view
    for which, a, b in zip("xyz", low, high, strict=True):
        getattr(axes, f"set_{which}lim")(a, b)
    axes.set_box_aspect(high - low, zoom=1.0)
    axes.locator_params(nbins=5)
    axes.tick_params(pad=1)
    upright.name(axes, 0, 1, 2)
    axes.zaxis.labelpad = 2


def _solid(axes: Any, space: Space) -> None:
    """Draw the obstacles' bodies and what the path keeps out of."""
    for faces in space.bodies:
        axes.add_collection3d(
            Poly3DCollection(list(faces), facecolor=f"{OBSTACLE}38", edgecolor=OBSTACLE, linewidth=0.9)
        )
    axes.scatter(*space.clouds.T, s=1.0, c=OBSTACLE, depthshade=False)
    for region in space.keep_out:
        hull = ConvexHull(region.outline)
        colour = QUIET if region.has_own_clearance else OBSTACLE
        axes.plot_trisurf(
            *region.outline.T, triangles=hull.simplices, color=colour, alpha=0.12, linewidth=0, shade=False
        )
        if not region.has_own_clearance and _inside(region.mark, space.view):
            axes.scatter(*region.mark, s=26, marker="x", c=OBSTACLE, depthshade=False)


def _flat(axes: Any, space: Space, columns: tuple[int, int]) -> None:
    """Draw everything seen along one axis."""
    flat = list(columns)
    _outlines(axes, space, flat)
    for number, line in enumerate(space.symbols):
        label = "camera" if number == 0 else None
        axes.plot(*line[:, flat].T, color=EXECUTED, lw=0.8, alpha=0.7, label=label)
    axes.plot(*space.executed[:, flat].T, color=EXECUTED, lw=3.2, label=words.EXECUTED)
    if space.planned is not None:
        axes.plot(*space.planned[:, flat].T, color=PLANNED, lw=1.4, label="planned")
    axes.plot(*space.points[:, flat].T, "o", ms=4.5, color="black", label="estimated points")
    low, high = space.view
    axes.set_xlim(low[columns[0]], high[columns[0]])
    axes.set_ylim(low[columns[1]], high[columns[1]])
    axes.set_aspect("equal", adjustable="box")
    axes.xaxis.set_major_locator(MaxNLocator(5, steps=[1, 2, 5, 10]))
    axes.yaxis.set_major_locator(MaxNLocator(5, steps=[1, 2, 5, 10]))


def _outlines(axes: Any, space: Space, flat: list[int]) -> None:
    """Draw the shadows of bodies, and of what the path keeps out of, on the page."""
    for number, faces in enumerate(space.bodies):
        seen = np.vstack(faces)[:, flat]
        outline = seen[ConvexHull(seen).vertices]
        label = "obstacle's body" if number == 0 else None
        axes.add_patch(Polygon(outline, facecolor=f"{OBSTACLE}40", edgecolor=OBSTACLE, lw=0.9, label=label))
    if len(space.clouds):
        axes.plot(*space.clouds[:, flat].T, ".", ms=1.2, color=OBSTACLE, label="points of a cloud")
    own_labelled = labelled = False
    for region in space.keep_out:
        seen = region.outline[:, flat]
        outline = seen[ConvexHull(seen).vertices]
        if region.has_own_clearance:
            label, own_labelled = None if own_labelled else "obstacle with a clearance of its own", True
            axes.add_patch(Polygon(outline, fill=False, edgecolor=QUIET, lw=0.9, label=label))
            continue
        label, labelled = None if labelled else "safe distance", True
        axes.add_patch(Polygon(outline, facecolor=f"{OBSTACLE}22", label=label))
        axes.plot(*region.mark[flat], "x", ms=6, color=OBSTACLE)


def _inside(place: FloatArray, view: FloatArray) -> bool:
    return bool(((place >= view[0]) & (place <= view[1])).all())
