"""Figures of a study: rates by method, where each converges from, and single rows."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.cm import ScalarMappable
from matplotlib.colors import Normalize
from matplotlib.patches import Circle, Rectangle

from omniservo.reporting.spelling import spell
from omniservo.reporting.style import (
    CERTIFIED,
    EXECUTED,
    GOAL,
    OBSTACLE,
    QUIET,
    SEVEN,
    START,
    Drawing,
    as_image,
    legend_below,
    new_axes,
    new_figure,
    styled,
)
from omniservo.studies import MethodSummary, RowResult, StudyTally
from omniservo.studies.study_arms import NO_ARM
from omniservo.studies.study_scene import StudyScene
from omniservo.studies.study_tally import MethodTally
from omniservo.studies.trajectory import Trajectory

_RATES = (
    ("success", SEVEN[2]), ("collision", SEVEN[1]), ("joint_limit", SEVEN[3]), ("feature_lost", SEVEN[0]),
    ("diverged", SEVEN[5]),
)  # fmt: skip
_SCATTERED = 400
"""Up to so many runs of a method each has a mark; of more, the share of successes in cells is drawn."""
_A_CELL = 20
"""runs of a method, on average"""
_MOST_CELLS = 12
_SHARES, _NO_START = "viridis", "#d9d9d9"
_MOST_COLUMNS = 4
_PANEL, _LEAST_WIDTH, _TALLEST = 2.9, 8.0, 4.0
"""[inch] least widths of a method's map and of a line of them, and what a map's height goes by at most"""


def study_drawings(tally: StudyTally) -> Iterator[Drawing]:
    """Yield the figures of a study; none where no row has a scene."""
    if tally.rows == tally.without:
        return
    with styled():
        yield _rates(tally.summaries())
    with styled():
        yield _regions(tally.methods)


def _rates(found: Sequence[MethodSummary]) -> Drawing:
    kinds = [
        (name, colour)
        for name, colour in _RATES
        if name == "success" or any(getattr(each, name).count for each in found)
    ]
    figure, axes = new_axes(9.0, 1.6 + 0.17 * len(kinds) * len(found))
    middle, apart = np.arange(len(found), dtype=np.float64), 0.75 / len(kinds)
    for k, (name, colour) in enumerate(kinds):
        rates = [getattr(each, name) for each in found]
        known = [i for i, rate in enumerate(rates) if rate.of]
        share = np.array([100.0 * rates[i].share for i in known])
        ends = np.array([[100.0 * end for end in rates[i].interval] for i in known]).reshape(-1, 2)
        place = middle[known] + apart * (k - 0.5 * (len(kinds) - 1))
        off = np.abs(np.array([share - ends[:, 0], ends[:, 1] - share]))
        axes.barh(place, share, 0.9 * apart, color=colour, alpha=0.75, label=name.replace("_", " "))
        axes.errorbar(share, place, xerr=off, fmt="none", ecolor="#222222", elinewidth=1.1, capsize=2.5)
    axes.set_yticks(middle, [each.method for each in found])
    axes.invert_yaxis()
    axes.set_xlim(0.0, 100.0)
    axes.set_xlabel("share of the runs [%]; collision: with an obstacle or an arm; joint limit: with an arm")
    axes.grid(axis="y", visible=False)
    legend_below(figure, axes, len(kinds))
    caption = (
        "Lines are 95% confidence intervals (Wilson). All methods met the same scenes; what never "
        "happened is not drawn."
    )
    return Drawing("study-rates", "By method", caption, figure)


def _regions(found: Mapping[str, MethodTally]) -> Drawing:
    count = len(found)
    columns = count if count <= _MOST_COLUMNS else min(3, _MOST_COLUMNS, key=lambda k: -count % k)
    lines = -(-len(found) // columns)
    width = max(_PANEL, _LEAST_WIDTH / columns)
    figure = new_figure(width * columns + 0.6, 0.86 * min(width, _TALLEST) * lines + 0.7)
    grid = figure.subplots(lines, columns, squeeze=False, sharex=True, sharey=True)
    for axes in grid.flat[len(found) :]:
        axes.set_visible(False)
    scattered = True
    for axes, (method, own) in zip(grid.flat, found.items(), strict=False):
        turned, ratio = np.degrees(own.turned), np.array(own.ratio)
        scattered = len(turned) <= _SCATTERED
        _region(axes, turned, ratio, np.array(own.reached) > 0.0, scattered)
        axes.set_title(method)
    for axes in grid[:, 0]:
        axes.set_ylabel("distance / goal's")
    for column in grid.T:
        lowest = [axes for axes in column if axes.get_visible()][-1]
        lowest.set_xlabel("start rotation [deg]")
        lowest.tick_params(labelbottom=True)
    if scattered:
        legend_below(figure, grid.flat[0], 2)
    else:
        scale = ScalarMappable(Normalize(0.0, 100.0), _SHARES)
        figure.colorbar(scale, ax=grid, label="reach the goal [%]", shrink=0.8, pad=0.02)
    caption = (
        "Each start by its rotation from the goal and its distance to the target over the goal's."
        if scattered
        else "Share of the starts in each cell that reach the goal; grey: no start is there."
    )
    return Drawing("study-regions", "Where each method reaches the goal from", caption, figure)


def _region(axes: Axes, turned: Any, ratio: Any, good: Any, scattered: bool) -> None:
    if scattered:
        axes.plot(turned[good], ratio[good], "o", ms=4, color=SEVEN[2], alpha=0.8, label="success")
        axes.plot(turned[~good], ratio[~good], "x", ms=5, color=CERTIFIED, label="no success")
        return
    across = min(max(int(math.sqrt(1.5 * len(turned) / _A_CELL)), 3), _MOST_CELLS)
    cells = across, round(across / 1.5)
    edges = _ends(turned, 1.0), _ends(ratio, 0.1)
    both, x, y = np.histogram2d(turned, ratio, bins=cells, range=edges)
    reached, _, _ = np.histogram2d(turned[good], ratio[good], bins=cells, range=edges)
    share = np.where(both > 0, reached / np.maximum(both, 1), np.nan)
    axes.pcolormesh(x, y, share.T, vmin=0.0, vmax=1.0, cmap=_SHARES)
    axes.set_facecolor(_NO_START)
    axes.grid(visible=False)


def _ends(values: Any, least: float) -> tuple[float, float]:
    """Return the range of values, so wide at least."""
    room = max(0.5 * (least - np.ptp(values)), 0.0)
    return float(values.min()) - room, float(values.max()) + room


def draw_row(result: RowResult) -> Drawing:
    """Draw what a row's camera saw and where it went; of one without a scene nothing but words."""
    with styled():
        return _drawn_row(result)


def _drawn_row(result: RowResult) -> Drawing:
    row, scene, trajectory = result.row, result.scene, result.trajectory
    figure = new_figure(6.6, 3.1)
    carried = "" if row.arm == NO_ARM else f" on {row.arm}"
    name, title = f"row-{row.row}", f"Row {row.row}: {row.method}, {row.camera}{carried}"
    if scene is None or trajectory is None:
        figure.text(0.02, 0.5, row.reason[:120])
        return Drawing(name, title, row.reason, figure)
    image, space = figure.subplots(1, 2, width_ratios=(1.2, 1.0))
    _draw_image(image, scene, trajectory)
    _draw_space(space, scene, trajectory)
    legend_below(figure, space, 4)
    ended = f"{row.status}{': ' if row.reason else ''}{row.reason}".replace("_", " ")
    off = 1e3 * (row.final_translation_error_m or 0.0), math.degrees(row.final_rotation_error_rad or 0.0)
    gap = "" if row.least_gap_m is None else f"; least distance to an obstacle {spell(row.least_gap_m, 'm')}"
    if row.least_link_gap_m is not None:
        gap += f", of a link to a ball or the floor {spell(row.least_link_gap_m, 'm')}"
    caption = (
        f"{ended}. Turned by {math.degrees(scene.drawn.rotation):.0f}° at {scene.drawn.distance_ratio:.2f} "
        f"times the distance; ends {off[0]:.1f} mm and {off[1]:.2f}° off the goal{gap}."
    )
    return Drawing(name, title, caption, figure)


def _draw_image(axes: Axes, scene: StudyScene, trajectory: Trajectory) -> None:
    """Draw the points' true trajectories in the image."""
    camera = scene.camera
    ways = zip(trajectory.rotations, trajectory.places, strict=True)
    seen = [scene.shown((scene.points - centre) @ rotation) for rotation, centre in ways]
    pixels = np.array([np.where(ok[:, None], place, np.nan) for place, ok in seen])
    for points in pixels.transpose(1, 0, 2):
        axes.plot(*points.T, color=EXECUTED, lw=0.8, alpha=0.6)
    axes.plot(*pixels[0].T, "o", color=START, ms=3.5)
    axes.plot(*scene.shown(scene.initial_T_goal.inv().apply(scene.points))[0].T, "*", color=GOAL, ms=6)
    axes.add_patch(Rectangle((-0.5, -0.5), camera.width, camera.height, fill=False, ec=QUIET))
    as_image(axes, camera.width, camera.height)


def _draw_space(axes: Axes, scene: StudyScene, trajectory: Trajectory) -> None:
    """Draw the camera's way on the plane through start, goal and the target's middle."""
    goal = np.array(scene.initial_T_goal.translation)
    first, second = _plane(goal, scene.points.mean(axis=0))
    flat = np.array([first, second]).T
    axes.plot(*(scene.points @ flat).T, ".", color=QUIET, ms=4, label="target")
    for ball in scene.obstacles:
        middle = tuple((ball.center @ flat).tolist())
        axes.add_patch(Circle(middle, ball.radius, color=OBSTACLE, alpha=0.7))
        axes.add_patch(Circle(middle, ball.radius + scene.clearance, fill=False, ec=OBSTACLE, ls=":"))
    for ball in scene.after_move.obstacles if scene.moved else ():
        middle = tuple((ball.center @ flat).tolist())
        axes.add_patch(Circle(middle, ball.radius, fill=False, ec=OBSTACLE, ls="--"))
    axes.plot(*(trajectory.centres @ flat).T, color=EXECUTED, label="camera")
    axes.plot(0.0, 0.0, "o", color=START, label="start")
    axes.plot(*(goal @ flat), "*", color=GOAL, ms=9, label="goal")
    axes.set_aspect("equal", adjustable="datalim")
    axes.set_xlabel("along start to goal [m]")
    axes.set_ylabel("towards the target [m]")


def _plane(goal: Any, middle: Any) -> tuple[Any, Any]:
    length = float(np.linalg.norm(goal))
    first = goal / length if length > 0.0 else np.array([1.0, 0.0, 0.0])
    rest = middle - (middle @ first) * first
    size = float(np.linalg.norm(rest))
    return first, rest / size if size > 1e-9 else np.cross(first, [0.0, 1.0, 0.0])
