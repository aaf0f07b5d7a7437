"""What an estimate rests on, drawn: the matches, what is left of them, and how well each point is known."""

from __future__ import annotations

import math
from collections.abc import Iterator

import numpy as np
from matplotlib import colormaps
from matplotlib.axes import Axes
from matplotlib.patches import ConnectionPatch, Ellipse
from scipy.special import chdtri

from omniservo.estimation import TwoViewEstimate
from omniservo.geometry.arrays import ByteArray, FloatArray, IntArray
from omniservo.reporting.around_points import show_around
from omniservo.reporting.spelling import first_digit
from omniservo.reporting.style import (
    CERTIFIED,
    EXECUTED,
    GOAL,
    PLANNED,
    QUIET,
    START,
    Drawing,
    legend_below,
    new_figure,
    styled,
)
from omniservo.results.run_result import Seen

_MOST_LINES = 60
"""more would hide the images"""
_MOST_ARROWS = 250
_MOST_ELLIPSES = 60
_ARROW = 0.06
"""length of a long residual, part of the image's width"""
_LEAST_ELLIPSE = 0.02
"""ellipses whose median is smaller, as part of the figure, are enlarged"""


def estimate_drawings(seen: Seen, estimate: TwoViewEstimate) -> Iterator[Drawing]:
    """Yield the figures; the last two need an estimate with a pose."""
    with styled():
        yield _matches(seen, estimate)
    if estimate.initial_T_goal is None:
        return
    with styled():
        yield _residuals(seen, estimate)
    with styled():
        yield draw_structure(estimate)


def _matches(seen: Seen, estimate: TwoViewEstimate) -> Drawing:
    height, width = seen.initial_image.shape
    figure = new_figure(11.0, 0.6 + 5.3 * height / width)
    left, right = figure.subplots(1, 2)
    _picture(left, seen.initial_image, "Initial image")
    _picture(right, seen.goal_image, "Goal image")
    initial, goal, used = seen.matched.initial, seen.matched.goal, estimate.inliers
    colours = colormaps["turbo"](np.linspace(0.05, 0.95, max(len(initial), 1)))
    for axes, pixels in ((left, initial), (right, goal)):
        axes.scatter(*pixels[used].T, s=22, facecolors="none", edgecolors=colours[used], linewidths=1.1)
        axes.plot(*pixels[~used].T, "x", color=CERTIFIED, ms=5, mew=1.2, label="rejected")
    members = np.flatnonzero(used)
    drawn = _some(members, _MOST_LINES)
    for j in drawn:
        line = ConnectionPatch(
            initial[j], goal[j], "data", "data", axesA=left, axesB=right, color=colours[j], lw=0.7, alpha=0.7
        )
        line.set_in_layout(False)
        figure.add_artist(line)
    for axes, pixels in ((left, initial), (right, goal)):
        show_around(axes, pixels)
    if not used.all():
        legend_below(figure, left, 1)
    rest = "" if used.all() else f", the other {len(initial) - len(members)} are crossed out"
    fewer = f" Lines for {len(drawn)} of them." if len(drawn) < len(members) else ""
    caption = f"{len(initial)} points were matched; {len(members)} agree with one motion{rest}.{fewer}"
    return Drawing("matches", "The same points in both images", caption, figure, is_picture=True)


def _residuals(seen: Seen, estimate: TwoViewEstimate) -> Drawing:
    height, width = seen.initial_image.shape
    figure = new_figure(11.0, 0.6 + 5.3 * height / width)
    chosen = _some(np.flatnonzero(estimate.inliers), _MOST_ARROWS)
    left = estimate.residuals_px[chosen]
    lengths = np.hypot(left[:, [0, 2]], left[:, [1, 3]])
    scale = first_digit(_ARROW * width / max(float(np.quantile(lengths, 0.95)), 1e-9))
    pictures = (
        ("Initial image", seen.matched.initial, left[:, :2]),
        ("Goal image", seen.matched.goal, left[:, 2:]),
    )
    for axes, (title, pixels, residual) in zip(figure.subplots(1, 2), pictures, strict=True):
        axes.set_title(title)
        axes.set_xlim(-0.5, width - 0.5)
        axes.set_ylim(height - 0.5, -0.5)
        axes.set_aspect("equal")
        axes.set_xlabel("u [px]")
        axes.set_ylabel("v [px]")
        at = pixels[chosen]
        axes.plot(*at.T, ".", color=QUIET, ms=3)
        show_around(axes, at)
        axes.quiver(*at.T, *(scale * residual).T, angles="xy", scale_units="xy", scale=1.0, width=0.003,
                    color=EXECUTED)  # fmt: skip
    caption = (
        f"Projection minus pixel, {scale:g} times as long; rms {estimate.rms_px:.3f} px, σ of a coordinate "
        f"{estimate.noise_px:.3f} px. Arrows that agree in a place show an error of the camera's calibration."
    )
    return Drawing("estimate-residuals", "What is left in the images", caption, figure)


def draw_structure(estimate: TwoViewEstimate) -> Drawing:
    """Return motion and structure of an estimate with a pose, from above and from the right."""
    figure = new_figure(11.0, 5.0)
    used = np.flatnonzero(estimate.inliers & np.isfinite(estimate.points).all(axis=1))
    unit, factor = ("mm", 1e3) if estimate.is_metric else ("lengths of t", 1.0)
    points, shown = factor * estimate.points[used], _some(used, _MOST_ELLIPSES)
    centres, spread = factor * estimate.points[shown], factor**2 * estimate.points_covariance[shown]
    sides = figure.subplots(1, 2)
    enlarged = 1.0
    for axes, (title, across, up) in zip(
        sides, (("From above", 0, 2), ("From the right", 2, 1)), strict=True
    ):
        _cameras(axes, estimate, factor, across, up)
        axes.plot(points[:, across], points[:, up], ".", color="black", ms=3.5, label="points")
        axes.set_aspect("equal", adjustable="datalim")
        axes.autoscale_view()
        axes.set_title(title)
        axes.set_xlabel(f"{'xyz'[across]} [{unit}]")
        axes.set_ylabel(f"{'xyz'[up]} [{unit}]")
        if up == 1:
            axes.invert_yaxis()
        if axes is sides[0]:
            enlarged = _enlargement(axes, spread[:, [across, up]][:, :, [across, up]])
        _ellipses(axes, centres[:, [across, up]], spread[:, [across, up]][:, :, [across, up]], enlarged)
    axes = sides[0]
    axes.plot([], [], "-", color=PLANNED, label="95% of each point")
    legend_below(figure, axes, 4)
    some = "" if len(shown) == len(used) else f", for {len(shown)} of them"
    larger = "" if enlarged == 1.0 else f" Ellipses are drawn {enlarged:.0f} times as large."
    caption = (
        "Points and both cameras in the initial camera frame, each point with the ellipse that holds it with "
        f"95%{some}.{larger}"
    )
    return Drawing("structure", "Motion and structure, with their uncertainty", caption, figure)


def _some(rows: IntArray, most: int) -> IntArray:
    """Return at most so many of the rows, evenly taken."""
    if len(rows) <= most:
        return rows
    return np.asarray(rows[np.linspace(0, len(rows) - 1, most).round().astype(int)])


def _picture(axes: Axes, image: ByteArray, title: str) -> None:
    axes.imshow(image, cmap="gray", vmin=0, vmax=255, interpolation="antialiased")
    axes.set_title(title)
    axes.set_axis_off()


def _cameras(axes: Axes, estimate: TwoViewEstimate, factor: float, across: int, up: int) -> None:
    """Mark both camera centres, with a stroke along each optical axis."""
    pose = estimate.initial_T_goal
    if pose is None:
        return
    goal = factor * np.asarray(pose.translation)
    reach = 0.25 * factor * float(np.median(np.linalg.norm(estimate.points[estimate.inliers], axis=1)))
    axis = reach * pose.rotation.apply([0.0, 0.0, 1.0])
    for centre, ahead, colour, name in (
        (np.zeros(3), np.array([0.0, 0.0, reach]), START, "initial camera"),
        (goal, axis, GOAL, "goal camera"),
    ):
        axes.plot(centre[across], centre[up], "s", color=colour, ms=7, label=name)
        axes.plot(
            [centre[across], centre[across] + ahead[across]], [centre[up], centre[up] + ahead[up]],
            "-", color=colour, lw=1.4,
        )  # fmt: skip


def _enlargement(axes: Axes, spread: FloatArray) -> float:
    """Return 1, or the power of ten that makes the median ellipse visible."""
    left, right = axes.get_xlim()
    radius = math.sqrt(_quantile()) * float(np.median(np.sqrt(np.trace(spread, axis1=1, axis2=2))))
    share = radius / abs(right - left)
    if share >= _LEAST_ELLIPSE or share <= 0.0:
        return 1.0
    return float(10.0 ** math.floor(math.log10(10.0 * _LEAST_ELLIPSE / share)))


def _ellipses(axes: Axes, centres: FloatArray, spread: FloatArray, enlarged: float) -> None:
    for centre, covariance in zip(centres, spread, strict=True):
        if not np.isfinite(covariance).all():
            continue
        values, vectors = np.linalg.eigh(covariance)
        width, height = 2.0 * enlarged * np.sqrt(_quantile() * np.maximum(values, 0.0))
        turn = math.degrees(math.atan2(vectors[1, 0], vectors[0, 0]))
        axes.add_patch(Ellipse(tuple(centre), width, height, angle=turn, fill=False, ec=PLANNED, lw=1.0))


def _quantile() -> float:
    """The χ² value of two degrees of freedom that 95% stay below."""
    return float(chdtri(2, 0.05))
