"""Draw the documentation's pictures into docs/images/doc: ``python -m benchmarks.doc_pictures [NAME …]``.

Without names all of them; a run of the simulator is done for those whose name begins with ``run-``.
"""

from __future__ import annotations

import io
import re
import sys
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import yaml
from benchmarks.rooms_picture import draw_rooms
from benchmarks.whole_job import whole_run
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import Circle, Polygon
from PIL import Image
from scipy.spatial.transform import RigidTransform, Rotation

import omniservo
from omniservo.geometry.arrays import FloatArray
from omniservo.perception import tag_picture
from omniservo.planning import Capsule, PlanningProblem
from omniservo.replanning import replan
from omniservo.reporting.arm_figure import draw_arm
from omniservo.reporting.camera_field import draw_field
from omniservo.reporting.figure_files import image_bytes
from omniservo.reporting.moment_figure import draw_moment
from omniservo.reporting.style import (
    CERTIFIED,
    EXECUTED,
    GOAL,
    OBSTACLE,
    PLANNED,
    QUIET,
    REQUIRED,
    START,
    THREE,
    legend_below,
    new_figure,
    styled,
)
from omniservo.reporting.write_figures import drawings
from omniservo.robots import load_arm
from omniservo.servoing import ExponentialLaw, RestToRestLaw

DOCS = Path(__file__).resolve().parents[1] / "docs"
FOLDER = DOCS / "images" / "doc"
OF_A_RUN = {
    "run-path": "path-3d",
    "run-image": "image",
    "run-clearance": "clearance",
    "run-joints": "joint-positions",
    "run-outside": "outside",
    "run-images": "views",
    "run-error": "image-error",
}
"""Pictures of the docs that are figures of a run of paper-example-1."""

_WIDEST = 1200
_UPRIGHT = [0.0, 0.0, 0.0, 1.0]


def code_of(page: str) -> dict[str, Any]:
    """Return the names that a page's first Python block leaves."""
    block = re.search(r"```python\n(.*?)```", (DOCS / page).read_text(), re.DOTALL)
    assert block is not None
    names: dict[str, Any] = {}
    exec(compile(block[1], page, "exec"), names)  # noqa: S102 — our own page
    return names


def first_plan() -> bytes:
    """Draw the plan of docs/start.md at the place with the least left."""
    block = re.search(
        r"<!-- first-problem -->\n```yaml\n(.*?)```", (DOCS / "start.md").read_text(), re.DOTALL
    )
    assert block is not None
    plan = omniservo.plan_path(PlanningProblem.from_dict(yaml.safe_load(block[1])))
    return image_bytes(draw_moment(plan), "png")


def field_of_view() -> bytes:
    """Draw what the paper's fisheye sees."""
    camera = omniservo.preset("fe185")
    return image_bytes(draw_field(camera, camera)[0], "png")


def arm() -> bytes:
    """Draw a shipped arm, as ``robot show --out`` does."""
    q = np.radians([0.0, -90.0, 90.0, -90.0, -90.0, 0.0])
    return image_bytes(draw_arm(load_arm("ur5e"), q)[0], "png")


def frames() -> bytes:
    """Draw the initial camera frame, the goal and the path between them."""
    figure = new_figure(6.4, 4.4)
    axes: Any = figure.add_subplot(projection="3d")
    goal = RigidTransform.from_components([0.25, -0.1, 0.3], Rotation.from_rotvec([0.2, -0.5, 0.0]))
    for name, pose in (("initial camera", RigidTransform.identity()), ("goal camera", goal)):
        for axis, colour, letter in zip(np.eye(3), THREE, "xyz", strict=True):
            begin, end = pose.apply(np.zeros(3)), pose.apply(0.12 * axis)
            axes.plot(*_up(np.array([begin, end])), color=colour)
            axes.text(*_up(end[None])[:, 0], letter, color=colour)
        axes.text(*_up(pose.apply([0.0, 0.06, 0.0])[None])[:, 0], name)
    w = np.linspace(0.0, 1.0, 50)[:, None]
    way = w * goal.translation + w * (1.0 - w) * np.array([0.1, 0.25, -0.1])
    axes.plot(*_up(way), color=PLANNED, label="path, w = 0 … 1")
    points = np.array([[x, y, 0.7] for x in (0.0, 0.15) for y in (-0.1, 0.05)])
    axes.scatter(*_up(points), color="black", label="target's points")
    axes.set(xlabel="z, ahead [m]", ylabel="x, right [m]", zlabel="−y, up [m]")
    axes.view_init(22, -125)
    axes.set_box_aspect((2.0, 1.2, 1.0))
    legend_below(figure, axes, 2)
    return _png(figure)


def _up(points: FloatArray) -> FloatArray:
    """Return rows z, x, −y: as a person stands in the scene."""
    return np.array([points[:, 2], points[:, 0], -points[:, 1]])


def proof() -> bytes:
    """Draw why a polynomial is nowhere negative: its Bernstein coefficients, before and after halving."""
    coefficients = np.array([1.0, -0.5, 0.3, -0.4, 1.2])
    figure = new_figure(8.4, 3.4)
    whole, halves = figure.subplots(1, 2, sharey=True)
    _bernstein(whole, coefficients, 0.0, 1.0)
    whole.set_title("undecided: two coefficients < 0")
    left, right = _halved(coefficients)
    pieces = [(left, 0.0, 0.5), (right, 0.5, 1.0)]
    for piece in pieces:
        for half, begin, end in zip(
            _halved(piece[0]), (piece[1], sum(piece[1:]) / 2), (sum(piece[1:]) / 2, piece[2]), strict=True
        ):
            _bernstein(halves, half, begin, end)
    halves.set_title("proven: none is negative on any piece")
    for axes in (whole, halves):
        axes.axhline(0.0, color=CERTIFIED, ls="--")
        axes.set_xlabel("w")
    whole.set_ylabel("p(w), and its coefficients")
    return _png(figure)


def _bernstein(axes: Axes, coefficients: FloatArray, begin: float, end: float) -> None:
    n = len(coefficients)
    places = np.linspace(begin, end, n)
    negative = coefficients < 0.0
    axes.plot(places, coefficients, color=QUIET, lw=1.0, marker="o", ms=4)
    axes.plot(places[negative], coefficients[negative], ls="", marker="o", color=CERTIFIED)
    t = np.linspace(0.0, 1.0, 60)
    axes.plot(begin + t * (end - begin), [_value(coefficients, x) for x in t], color=EXECUTED)


def _value(coefficients: FloatArray, t: float) -> float:
    return float(_halved(coefficients, t)[0][-1])


def _halved(coefficients: FloatArray, t: float = 0.5) -> tuple[FloatArray, FloatArray]:
    rows = [coefficients]
    while len(rows[-1]) > 1:
        rows.append((1.0 - t) * rows[-1][:-1] + t * rows[-1][1:])
    return np.array([row[0] for row in rows]), np.array([row[-1] for row in rows[::-1]])


def time_laws() -> bytes:
    """Draw w and its speed of the two laws that need no arm."""
    figure = new_figure(8.4, 3.2)
    place, speed = figure.subplots(1, 2)
    times = np.linspace(0.0, 6.0, 300)
    laws = {"rest-to-rest, 4 s": RestToRestLaw(4.0), "exponential, rate 1": ExponentialLaw(1.0)}
    for (name, law), colour in zip(laws.items(), THREE, strict=False):
        w = np.array([law(t) for t in times])
        place.plot(times, w[:, 0], color=colour, label=name)
        speed.plot(times, w[:, 1], color=colour)
    place.set(xlabel="time [s]", ylabel="w [1]")
    speed.set(xlabel="time [s]", ylabel="speed of w [1/s]")
    legend_below(figure, place, 2)
    return _png(figure)


def search() -> bytes:
    """Draw from above the straight way, and what the search finds among three rods."""
    rods = tuple(_rod(x, z) for x, z in ((0.1, 0.07), (0.21, 0.25), (0.1, 0.22)))
    points = np.array([[x, y, 0.7] for x in (0.0, 0.15, 0.3) for y in (-0.1, 0.1)])
    figure = new_figure(6.0, 4.6)
    axes = figure.subplots()
    problem = PlanningProblem(
        omniservo.preset("fe185"), points, RigidTransform.from_translation([0.3, 0.0, 0.3]),
        obstacles=rods, clearance=0.03,
    )  # fmt: skip
    _way(axes, omniservo.plan_path(problem), PLANNED, "what is found at degree 2")
    _rods(axes, rods, 0.03)
    axes.plot([0.0, 0.3], [0.0, 0.3], color=QUIET, ls=":", label="straight on")
    _from_above(axes)
    legend_below(figure, axes, 3)
    return _png(figure)


def replanned() -> bytes:
    """Draw from above a path, and the one that is followed once a rod is seen on it."""
    points = np.array([[x, y, 0.7] for x in (0.0, 0.15, 0.3) for y in (-0.1, 0.1)])
    goal = RigidTransform.from_translation([0.3, 0.0, 0.3])
    problem = PlanningProblem(omniservo.preset("fe185"), points, goal, obstacles=(), clearance=0.05)
    plan = omniservo.plan_path(problem)
    rod, begin = _rod(0.2, 0.22), 0.3
    found = replan(plan, begin, replace(problem, obstacles=(rod,)))
    assert plan.path is not None
    assert found.path is not None
    figure = new_figure(6.0, 4.6)
    axes = figure.subplots()
    _way(axes, plan, QUIET, "as planned at first")
    rest = RigidTransform.from_translation(plan.path(begin).translation)
    ways = np.array([(plan.path(begin) * found.path(w)).translation for w in np.linspace(0.0, 1.0, 100)])
    axes.plot(ways[:, 0], ways[:, 2], color=PLANNED, label="from here on, proven again")
    axes.plot(*rest.translation[[0, 2]], marker="o", color=START, ls="", label="where it is seen")
    _rods(axes, (rod,), 0.05)
    _from_above(axes)
    legend_below(figure, axes, 3)
    return _png(figure)


def depth_camera() -> bytes:
    """Draw the depth image of docs/depth-camera.md and the plan past its cloud, from above."""
    names = code_of("depth-camera.md")
    figure = new_figure(8.8, 3.6)
    image, axes = figure.subplots(1, 2)
    shown = image.imshow(np.where(names["depth"] > 0.0, names["depth"], np.nan), cmap="viridis")
    figure.colorbar(shown, ax=image, label="depth [m]")
    image.set(title="depth image", xlabel="u [px]", ylabel="v [px]")
    cloud = names["cloud"]
    for point in cloud.points:
        axes.add_patch(Circle(point[[0, 2]], cloud.radius, color=OBSTACLE, alpha=0.15, lw=0))
    _way(axes, names["plan"], PLANNED, "planned")
    axes.plot([0.0, 0.3], [0.0, 0.3], color=QUIET, ls=":", label="straight on")
    _from_above(axes)
    axes.legend()
    return _png(figure)


def uncertainty() -> bytes:
    """Draw where the goal may be by one noisy estimate, and two standard deviations of it."""
    rng = np.random.default_rng(4)
    camera = omniservo.preset("fe185")
    truth = rng.uniform([-0.15, -0.12, 0.4], [0.15, 0.12, 0.6], (20, 3))
    moved = RigidTransform.from_components([0.1, -0.05, 0.12], Rotation.from_rotvec([0.0, -0.2, 0.1]))
    seen = [
        camera.project(p)[0] + 0.3 * rng.standard_normal((20, 2)) for p in (truth, moved.inv().apply(truth))
    ]
    found = omniservo.estimate_two_view(camera, seen[0], seen[1], scale=0.164, scale_sigma=0.03)
    places = 1e3 * found.sample(rng, 3000, camera=camera).initial_T_goal.translation[:, [0, 2]]
    figure = new_figure(5.6, 4.2)
    axes = figure.subplots()
    axes.plot(*places.T, ls="", marker=".", ms=2, color=QUIET, label="equally likely goals")
    axes.plot(*(1e3 * moved.translation[[0, 2]]), ls="", marker="*", ms=12, color=GOAL, label="true goal")
    spread = 1e6 * found.covariance[np.ix_([0, 2], [0, 2])]
    assert found.initial_T_goal is not None
    ring = np.linalg.cholesky(spread) @ np.array([np.cos(t := np.linspace(0, 2 * np.pi, 90)), np.sin(t)])
    middle = 1e3 * found.initial_T_goal.translation[[0, 2], None]
    axes.plot(*(middle + 2.0 * ring), color=CERTIFIED, ls="--", label="2 σ of the stated covariance")
    axes.set(xlabel="x [mm]", ylabel="z [mm]", aspect="equal")
    legend_below(figure, axes, 3)
    return _png(figure)


def motion() -> bytes:
    """Draw how points move between two images of a fisheye, and which match is wrong."""
    camera, rng = omniservo.preset("fe185"), np.random.default_rng(2)
    truth = rng.uniform([-0.4, -0.3, 0.3], [0.4, 0.3, 0.7], (40, 3))
    moved = RigidTransform.from_components([0.08, -0.05, 0.1], Rotation.from_rotvec([0.05, -0.1, 0.1]))
    first, second = (camera.project(p)[0] for p in (truth, moved.inv().apply(truth)))
    second = second + 0.2 * rng.standard_normal(second.shape)
    second[:3] += rng.uniform(30.0, 60.0, (3, 2))
    found = omniservo.estimate_two_view(camera, first, second, scale=0.14)
    figure = new_figure(6.4, 4.4)
    axes = figure.subplots()
    for rows, colour, name in (
        (found.inliers, EXECUTED, "agrees with the motion"),
        (~found.inliers, CERTIFIED, "wrong match, rejected"),
    ):
        axes.quiver(
            *first[rows].T,
            *(second - first)[rows].T,
            color=colour,
            angles="xy",
            scale_units="xy",
            scale=1.0,
            width=0.004,
            label=name,
        )
    axes.set(
        xlim=(0, camera.width), ylim=(camera.height, 0), xlabel="u [px]", ylabel="v [px]", aspect="equal"
    )
    legend_below(figure, axes, 2)
    return _png(figure)


def tag() -> bytes:
    """Draw a tag with its axes, its edge and the order of its corners."""
    figure = new_figure(4.6, 4.2)
    axes = figure.subplots()
    axes.imshow(tag_picture("tag36h11", 3, pixels_per_cell=10), cmap="gray", extent=(-5, 5, 5, -5))
    axes.add_patch(Polygon([[-4, -4], [4, -4], [4, 4], [-4, 4]], fill=False, ec=PLANNED, lw=2.5))
    for k, (x, y) in enumerate([(-4, -4), (4, -4), (4, 4), (-4, 4)]):
        axes.annotate(f"corner {k}", (x, y), (1.32 * x, 1.22 * y), ha="center", va="center", color=PLANNED)
    for (x, y), colour, letter in (((2.6, 0), THREE[0], "x"), ((0, 2.6), THREE[1], "y")):
        axes.annotate("", (x, y), (0, 0), arrowprops={"arrowstyle": "-|>", "color": colour, "lw": 2.5})
        axes.text(
            1.2 * x, 1.2 * y, letter, color=colour, fontsize=14, ha="center", va="center", fontweight="bold"
        )
    axes.set(xlim=(-6.6, 6.6), ylim=(6.2, -6.2))
    axes.set_axis_off()
    axes.set_title("the edge is that of the dark border", fontweight="normal")
    return _png(figure)


def mount() -> bytes:
    """Draw the chain of poses of a hand-eye calibration."""
    figure = new_figure(7.6, 2.6)
    axes = figure.subplots()
    places = {"base": (0.0, 0.0), "flange": (2.0, 1.0), "camera": (3.2, 0.7), "board": (5.6, 0.0)}
    known = [
        ("base", "flange", "base_T_flange\nreported by the robot", EXECUTED),
        ("camera", "board", "camera_T_board\nfrom each image", EXECUTED),
    ]
    wanted = [
        ("flange", "camera", "flange_T_camera\nwanted", CERTIFIED),
        ("base", "board", "base_T_board\nfound besides", QUIET),
    ]
    for begin, end, words, colour in known + wanted:
        a, b = np.array(places[begin]), np.array(places[end])
        axes.annotate(
            "", b, a, arrowprops={"arrowstyle": "-|>", "color": colour, "lw": 2, "shrinkA": 22, "shrinkB": 22}
        )
        below = begin == "base" and end == "board"
        middle = (a + b) / 2 + ([0.0, -0.28] if below else [-0.1, 0.36])
        axes.text(*middle, words, ha="center", va="center", color=colour, fontsize=8.5)
    for name, place in places.items():
        axes.text(
            *place, name, ha="center", va="center", bbox={"boxstyle": "round", "fc": "white", "ec": REQUIRED}
        )
    axes.set(xlim=(-0.6, 6.2), ylim=(-0.6, 1.7))
    axes.set_axis_off()
    return _png(figure)


def calibrated() -> bytes:
    """Draw the corners of the calibration of docs/calibration.md, with the residuals enlarged."""
    names = code_of("calibration.md")
    camera = names["truth"]
    figure = new_figure(6.4, 4.4)
    axes = figure.subplots()
    for corners, colour in zip(names["images"], (*THREE, *THREE, *THREE), strict=False):
        axes.plot(*np.asarray(corners).T, ls="", marker=".", ms=4, color=colour)
    axes.set(
        xlim=(0, camera.width), ylim=(camera.height, 0), xlabel="u [px]", ylabel="v [px]", aspect="equal"
    )
    axes.set_title("corners of eight views of a board", fontweight="normal")
    return _png(figure)


def _way(axes: Axes, plan: omniservo.Plan, colour: str, label: str) -> None:
    assert plan.path is not None
    places = np.array([plan.path(w).translation for w in np.linspace(0.0, 1.0, 200)])
    axes.plot(places[:, 0], places[:, 2], color=colour, label=label)


def _rod(x: float, z: float) -> Capsule:
    """Return an upright rod, which can be passed to its left and right alone."""
    return Capsule(np.array([x, -0.5, z]), np.array([x, 0.5, z]), 0.015)


def _rods(axes: Axes, rods: tuple[Capsule, ...], clearance: float) -> None:
    for rod in rods:
        place = rod.start[[0, 2]]
        axes.add_patch(Circle(place, rod.radius + clearance, color=OBSTACLE, alpha=0.15, lw=0))
        axes.add_patch(Circle(place, rod.radius, color=OBSTACLE, alpha=0.7, lw=0))


def _from_above(axes: Axes) -> None:
    axes.set(xlabel="x, right [m]", ylabel="z, ahead [m]", aspect="equal")


def rooms() -> bytes:
    """Draw the rooms of the package by their layers."""
    return _png(draw_rooms())


def _png(figure: Figure) -> bytes:
    buffer = io.BytesIO()
    figure.savefig(buffer, format="png", dpi=120)
    return buffer.getvalue()


PICTURES: dict[str, Callable[[], bytes]] = {
    "first-plan": first_plan,
    "field-of-view": field_of_view,
    "arm": arm,
    "frames": frames,
    "proof": proof,
    "time-laws": time_laws,
    "search": search,
    "replanned": replanned,
    "depth-camera": depth_camera,
    "uncertainty": uncertainty,
    "motion": motion,
    "tag": tag,
    "mount": mount,
    "calibrated": calibrated,
    "rooms": rooms,
}


def write(name: str, content: bytes) -> None:
    """Write a picture, no wider than a page shows it, with few colours."""
    picture = Image.open(io.BytesIO(content)).convert("RGB")
    if picture.width > _WIDEST:
        picture = picture.resize(
            (_WIDEST, round(picture.height * _WIDEST / picture.width)), Image.Resampling.LANCZOS
        )
    FOLDER.mkdir(parents=True, exist_ok=True)
    picture.quantize(192).save(FOLDER / f"{name}.png", optimize=True)


def main(wanted: list[str]) -> None:
    """Draw the named pictures, or all."""
    names = wanted or [*PICTURES, *OF_A_RUN]
    for name in names:
        if name in PICTURES:
            with styled():
                write(name, PICTURES[name]())
    figures = {OF_A_RUN[name]: name for name in names if name in OF_A_RUN}
    if figures:
        for drawing in drawings(whole_run("paper-example-1")):
            if drawing.name in figures:
                write(figures[drawing.name], image_bytes(drawing, "png"))


if __name__ == "__main__":
    main(sys.argv[1:])
