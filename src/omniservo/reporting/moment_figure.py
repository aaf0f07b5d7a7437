"""The moment at which a plan comes nearest to what it must not do, or does it."""

from __future__ import annotations

import re
import textwrap

import numpy as np
from matplotlib.axes import Axes
from matplotlib.lines import Line2D
from matplotlib.patches import Circle, Patch, Polygon, Rectangle
from scipy.spatial import ConvexHull
from scipy.spatial.transform import RigidTransform

from omniservo.geometry.arrays import FloatArray
from omniservo.planning import (
    Cloud,
    ConstraintMargin,
    HalfSpace,
    Plan,
    worst_moment,
)
from omniservo.planning.obstacles.obstacle import Obstacle
from omniservo.reporting.spelling import spell
from omniservo.reporting.style import (
    CERTIFIED,
    EXECUTED,
    FORBIDDEN,
    GOAL,
    OBSTACLE,
    PLANNED,
    QUIET,
    REQUIRED,
    START,
    Drawing,
    new_figure,
    styled,
)

_CELLS = 220
"""of a view, along a side"""
_SHOWN_OF_CLOUD = 2000
_LEAST = 1e-3
"""[m] a point is drawn so large"""
_CIRCLE = np.stack([np.cos(_TURN := np.linspace(0.0, 2.0 * np.pi, 49)[:-1]), np.sin(_TURN)], axis=-1)
_PLACES = np.linspace(0.0, 1.0, 201)
_VIEWS = (("along the initial camera's y", 0, 2), ("along its x", 2, 1))
"""title, and which axes of the initial camera go to the right and up"""
_NAMES = ("x [mm]", "y [mm], down", "z [mm], ahead")


def draw_moment(plan: Plan) -> Drawing:
    """Return the worst moment of a plan: what the camera sees there, and two views of the path.

    Of a plan that is certified it is the moment with the least left; of a problem without a path the end pose
    that no path can have.
    """
    worst = worst_moment(plan)
    w = 0.0 if worst is None else worst.w
    pose = _pose(plan, w)
    with styled():
        figure = new_figure(12.6, 4.6)
        image, above, side = figure.subplots(1, 3, width_ratios=(1.25, 1.0, 1.0))
        _draw_image(image, plan, pose, worst)
        for axes, (title, right, up) in zip((above, side), _VIEWS, strict=True):
            _draw_view(axes, plan, pose, w, worst, (right, up))
            axes.set_title(title)
        title = textwrap.fill(_headline(plan, worst), 110)
        figure.suptitle(title, x=0.01, ha="left", fontsize=12, fontweight="bold")
        figure.legend(handles=_legend(plan), loc="outside lower center", ncols=5)
    said = plan.reason or "every constraint is proven"
    caption = (
        f"{plan.status}: {said}. Initial camera frame. Filled: obstacles, "
        "projected. Dotted: what the camera's centre keeps from them, cut where the centre is."
    )
    return Drawing("moment", _headline(plan, worst), caption, figure)


def _pose(plan: Plan, w: float) -> RigidTransform:
    if plan.path is not None:
        return plan.path(w)
    return plan.problem.initial_T_goal if w == 1.0 else RigidTransform.identity()


def _headline(plan: Plan, worst: ConstraintMargin | None) -> str:
    if worst is None:
        return f"{plan.status}: {plan.reason}"
    amount = spell(abs(worst.margin), worst.unit)
    left = f"{amount} short" if worst.margin < 0.0 else f"{amount} beyond what is required"
    left = "no pixel" if worst.is_unseen else left
    where = {0.0: "at the start", 1.0: "at the goal"}.get(worst.w, f"at w = {worst.w:.3f}")
    return f"{plan.status}: {worst.name}: {left} {where}"


def _number(worst: ConstraintMargin | None, what: str) -> int | None:
    """Return which point or obstacle a constraint is about; None: it is about another thing."""
    found = None if worst is None else re.search(rf"{what} (\d+)", worst.name)
    return None if found is None else int(found[1])


def _draw_image(axes: Axes, plan: Plan, pose: RigidTransform, worst: ConstraintMargin | None) -> None:
    """Draw where the camera sees the points, and where it must see them."""
    problem, camera = plan.problem, plan.problem.camera
    axes.set_facecolor(FORBIDDEN)
    margin = problem.image_margin
    size = np.array([camera.width, camera.height])
    axes.add_patch(Rectangle((-0.5, -0.5), *size, fc="#e9ebee", ec=QUIET))
    inner = np.maximum(size - 2.0 * margin, 0.0)
    axes.add_patch(Rectangle((margin - 0.5, margin - 0.5), *inner, fc="white", ec=REQUIRED, ls=":", lw=1.4))
    if camera.dead_zone is not None:
        axes.add_patch(Circle(camera.dead_zone.center, camera.dead_zone.radius, fc=FORBIDDEN, ec=QUIET))
    for corners in camera.mask:
        axes.add_patch(Polygon(corners, closed=True, fc=FORBIDDEN, ec=QUIET))
    if plan.path is not None:
        ways = np.stack([camera.project(at.inv().apply(problem.points))[0] for at in plan.path(_PLACES[::4])])
        axes.plot(*np.moveaxis(ways, -1, 0), "-", color=PLANNED, lw=0.8, alpha=0.7)
    pixels, valid = camera.project(pose.inv().apply(problem.points))
    axes.plot(*pixels[valid].T, "o", ms=4, color="black")
    marked = _number(worst, "point")
    if marked is not None and valid[marked]:
        axes.plot(*pixels[marked], "o", ms=13, mfc="none", mec=CERTIFIED, mew=2.0)
        axes.annotate(
            f"point {marked}", pixels[marked], xytext=(9, 9), textcoords="offset points", color=CERTIFIED
        )
    seen = pixels[valid] if valid.any() else np.zeros((1, 2))
    low = np.minimum(-0.5, np.maximum(seen.min(axis=0), -0.5 * size)) - 0.03 * size
    high = np.maximum(size - 0.5, np.minimum(seen.max(axis=0), 1.5 * size)) + 0.03 * size
    axes.set_xlim(low[0], high[0])
    axes.set_ylim(high[1], low[1])
    axes.set_aspect("equal")
    axes.grid(visible=False)
    axes.set_xlabel("u [px]")
    axes.set_ylabel("v [px]")
    unseen = int((~valid).sum())
    axes.set_title("the camera's image" + (f", {unseen} points outside its lens" if unseen else ""))


def _draw_view(
    axes: Axes,
    plan: Plan,
    pose: RigidTransform,
    w: float,
    worst: ConstraintMargin | None,
    plane: tuple[int, int],
) -> None:
    """Draw path, points and obstacles along two axes of the initial camera."""
    problem, flat = plan.problem, list(plane)
    centre = pose.translation
    path = None if plan.path is None else plan.path(_PLACES).translation
    ends = np.stack([np.zeros(3), problem.initial_T_goal.translation, centre])
    shown = np.vstack([problem.points, ends, *([] if path is None else [path])])[:, flat]
    low, high = _square(shown)
    grid = np.stack(np.meshgrid(*(np.linspace(low[i], high[i], _CELLS) for i in (0, 1))), axis=-1)
    places = np.tile(centre, (_CELLS * _CELLS, 1))
    places[:, flat] = grid.reshape(-1, 2)
    marked = _number(worst, "obstacle")
    for number, obstacle in enumerate(problem.obstacles):
        asked = problem.clearance if obstacle.clearance is None else obstacle.clearance
        gaps = obstacle.distance(places - _moved(obstacle, w)).reshape(_CELLS, _CELLS)
        colour = CERTIFIED if number == marked else OBSTACLE
        x, y = 1e3 * grid[..., 0], 1e3 * grid[..., 1]
        _draw_body(axes, obstacle, flat, w, colour)
        if isinstance(obstacle, HalfSpace) and gaps.min() < 0.0:
            axes.contourf(x, y, gaps, levels=[-1e9, 0.0], colors=[colour], alpha=0.45)
        if gaps.min() < asked < gaps.max() and asked > 0.0:
            axes.contour(x, y, gaps, levels=[asked], colors=[colour], linestyles=":", linewidths=1.4)
    if path is not None:
        axes.plot(*(1e3 * path[:, flat]).T, color=PLANNED, lw=1.8)
    axes.plot(*(1e3 * problem.points[:, flat]).T, "o", ms=3.5, color="black")
    for end, colour in zip(ends[:2], (START, GOAL), strict=True):
        axes.plot(*(1e3 * end[flat]), "s", ms=6, color=colour)
    _draw_camera(axes, pose, flat, 0.07 * float(np.max(high - low)))
    axes.set_xlim(1e3 * low[0], 1e3 * high[0])
    upright = (1e3 * low[1], 1e3 * high[1])
    axes.set_ylim(*(upright if plane[1] != 1 else upright[::-1]))  # y of a camera points down
    axes.set_aspect("equal")
    axes.set_xlabel(_NAMES[plane[0]])
    axes.set_ylabel(_NAMES[plane[1]])


def _draw_body(axes: Axes, obstacle: Obstacle, flat: list[int], w: float, colour: str) -> None:
    """Fill what an obstacle covers of the view; of a cloud draw some points; a half-space has no outline."""
    moved = _moved(obstacle, w)
    if isinstance(obstacle, Cloud):
        some = obstacle.points[:: 1 + len(obstacle.points) // _SHOWN_OF_CLOUD] + moved
        axes.plot(*(1e3 * some[:, flat]).T, ".", ms=1.5, color=colour)
    elif not isinstance(obstacle, HalfSpace):
        corners, radius = obstacle.core.outline()
        around = (corners + moved)[:, None, flat] + max(radius, _LEAST) * _CIRCLE
        outline = 1e3 * around.reshape(-1, 2)
        hull = outline[ConvexHull(outline).vertices]
        axes.add_patch(Polygon(hull, closed=True, fc=colour, ec=colour, alpha=0.45))


def _draw_camera(axes: Axes, pose: RigidTransform, flat: list[int], length: float) -> None:
    """Draw the camera's centre and its viewing direction."""
    tip, centre = pose.apply([0.0, 0.0, length]), pose.translation
    (x, y), (u, v) = 1e3 * tip[flat], 1e3 * centre[flat]
    axes.annotate("", (x, y), (u, v), arrowprops={"arrowstyle": "-|>", "color": EXECUTED, "lw": 2.0})
    axes.plot(*(1e3 * centre[flat]), "o", ms=9, mfc="white", mec=EXECUTED, mew=2.2)


def _moved(obstacle: Obstacle, w: float) -> FloatArray:
    """Return by how much an obstacle is displaced at w (3,) [m]."""
    if obstacle.motion is None:
        return np.zeros(3)
    return np.array([np.polyval(row, w) for row in obstacle.motion])


def _square(shown: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return lowest and highest coordinates of a square that holds points (k, 2), with a margin."""
    middle = 0.5 * (shown.min(axis=0) + shown.max(axis=0))
    half = 0.62 * max(float(np.ptp(shown, axis=0).max()), 1e-3)
    return middle - half, middle + half


def _legend(plan: Plan) -> list[Line2D | Patch]:
    def marker(symbol: str, colour: str, label: str) -> Line2D:
        return Line2D([], [], ls="", marker=symbol, color=colour, label=label)

    entries: list[Line2D | Patch] = [
        marker("s", START, "start"),
        marker("s", GOAL, "goal"),
        Line2D([], [], ls="", marker="o", mfc="white", mec=EXECUTED, mew=2.2, ms=9, label="camera then"),
        marker("o", "black", "target's points"),
    ]
    if plan.path is not None:
        entries.append(
            Line2D([], [], color=PLANNED, label="best attempt" if plan.status != "certified" else "path")
        )
    if plan.problem.obstacles:
        entries.append(Patch(color=OBSTACLE, alpha=0.45, label="obstacle"))
        entries.append(Patch(color=CERTIFIED, alpha=0.45, label="obstacle that is named"))
    entries.append(Line2D([], [], color=REQUIRED, ls=":", label="what is required"))
    return entries
