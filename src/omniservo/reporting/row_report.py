"""The results of one row of a study, repeated alone: its images, its figures, its plan and a report."""

from __future__ import annotations

import json
import math
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from matplotlib.axes import Axes
from matplotlib.ticker import FuncFormatter
from scipy.spatial.transform import RigidTransform, Rotation

from omniservo.files import write_whole
from omniservo.files.image_files import write_png
from omniservo.geometry.arrays import ByteArray, FloatArray
from omniservo.reporting.around_points import frame_points
from omniservo.reporting.figure_files import image_bytes
from omniservo.reporting.framed_figure import framed
from omniservo.reporting.html import Markup, banner, judged, page, part, table, tag
from omniservo.reporting.spelling import NOTHING, spell
from omniservo.reporting.study_figures import draw_row
from omniservo.reporting.style import (
    EXECUTED,
    GOAL,
    OBSTACLE,
    REQUIRED,
    START,
    Drawing,
    legend_below,
    new_figure,
    styled,
)
from omniservo.simulation import StudyRenderer
from omniservo.studies import RowResult, Study, StudyRow, fields_of_row
from omniservo.studies.scene_start import images_at_ends
from omniservo.studies.study_camera import StudyCamera
from omniservo.studies.study_scene import StudyScene, generators
from omniservo.studies.trajectory import Trajectory

FIGURE, REPORT = "row.png", "report.html"
_UNITS = {"m": "m", "rad": "rad", "s": "s", "px": "px"}
_LEAST_MM, _LEAST_DEG = 1e-2, 1e-3
"""What lies below is drawn here: a logarithmic axis has no zero."""


def write_row_report(folder: Path, study: Study, result: RowResult) -> None:
    """Fill an empty folder with what a row was and what came of it.

    report.html, row.json and row.png; of a row with a scene the images initial.png, goal.png and final.png,
    and views.png with all three and their points; of a certified one plan.json, as `omniservo verify` and
    `omniservo view` read it.

    Raises:
        NotWritten: the disk is full, or the folder is not ours.
    """
    ways = draw_row(result)
    drawings = [ways]
    if result.scene is not None and result.trajectory is not None:
        views = _seen(study, result.scene, result.trajectory)
        for each in views:
            write_png(each.image, folder / f"{each.name}.png")
        with styled():
            drawn = _drawn_views(result.scene, views)
            drawings = [drawn, ways, _errors(study, result.scene, result.trajectory)]
        write_whole(folder / "views.png", image_bytes(drawn, "png"))
    certified = result.plan if result.row.certified else None
    if certified is not None:
        certified.save(folder / "plan.json")
    write_whole(folder / "row.json", json.dumps(fields_of_row(result.row), indent=1) + "\n")
    write_whole(folder / FIGURE, image_bytes(ways, "png"))
    write_whole(folder / REPORT, _html(study, result.row, drawings, certified is not None))


@dataclass(frozen=True, eq=False)
class _View:
    """What the camera sees from a pose."""

    name: str
    title: str
    image: ByteArray
    pixels: FloatArray
    """(n, 2) the points in it [px]; NaN: not found"""


def _seen(study: Study, scene: StudyScene, trajectory: Trajectory) -> tuple[_View, ...]:
    """Return what is seen from the start, the goal and the last pose, the first two as they were measured."""
    _, random = generators(study, scene.number)
    ends = images_at_ends(scene, StudyCamera(scene, random))
    measured = [np.where(image.found[:, None], image.pixels, np.nan) for image in ends]
    moved = scene.moved is not None and trajectory.times[-1] >= scene.moved.time
    last_scene = scene.after_move if moved else scene
    last = trajectory.end
    pixels, seen = last_scene.shown(last.inv().apply(scene.points))
    seen &= ~last_scene.hidden(scene.points, np.array(last.translation))
    at_start = StudyRenderer(scene)
    at_end = StudyRenderer(last_scene) if moved else at_start
    return (
        _View("initial", "Initial image", at_start.render(RigidTransform.identity()), measured[0]),
        _View("goal", "Goal image", at_start.render(scene.initial_T_goal), measured[1]),
        _View("final", "Last image", at_end.render(last), np.where(seen[:, None], pixels, np.nan)),
    )


def _drawn_views(scene: StudyScene, views: tuple[_View, ...]) -> Drawing:
    camera = scene.camera
    figure = new_figure(11.0, 0.5 + 7.4 * camera.height / camera.width)
    goal = views[1].pixels
    for (whole, near), view in zip(figure.subplots(2, 3).T, views, strict=True):
        for axes in (whole, near):
            axes.imshow(view.image, interpolation="antialiased")
            axes.set_axis_off()
        whole.set_title(view.title)
        last = view.name == "final"
        frame_points(whole, near, np.concatenate((view.pixels, goal)) if last else view.pixels)
        colour = GOAL if view.name == "goal" else START
        near.plot(*view.pixels.T, "o", ms=9, mfc="none", mec=colour, mew=1.2, ls="none")
        if last:
            near.plot(*goal.T, "*", color=GOAL, ms=6, ls="none")
    caption = (
        "Below each image its points, enlarged. Rings: the points as they were measured, in the last image "
        "where they truly are; one without a ring was not found, or is not seen. Blue stars in the last "
        "image: where the goal image has them. Images are those of the stated camera."
    )
    return Drawing("views", "What the camera saw", caption, figure, is_picture=True)


def _errors(study: Study, scene: StudyScene, trajectory: Trajectory) -> Drawing:
    """Draw over time how far the camera is from the goal, and how near it comes to obstacles."""
    times, centres = np.array(trajectory.times), trajectory.centres
    goal = np.array(scene.initial_T_goal.translation)
    apart = 1e3 * np.linalg.norm(centres - goal, axis=1)
    turns = Rotation.from_matrix(np.array(trajectory.rotations)) * scene.initial_T_goal.rotation.inv()
    angle = np.rad2deg(turns.magnitude())
    limits, count = study.limits, 3 if scene.obstacles else 2
    figure = new_figure(3.7 * count, 3.2)
    panels = figure.subplots(1, count)
    _over_time(panels[0], times, apart, 1e3 * limits.translation, _LEAST_MM, "distance to the goal [mm]")
    _over_time(panels[1], times, angle, math.degrees(limits.rotation), _LEAST_DEG, "angle to the goal [deg]")
    if scene.obstacles:
        panels[2].plot(times, 1e3 * _gaps(scene, trajectory), color=OBSTACLE, label="camera")
        panels[2].axhline(1e3 * scene.clearance, color=REQUIRED, ls=":", lw=1.6, label="limit")
        panels[2].set_xlabel("time [s]")
        panels[2].set_ylabel("to the nearest obstacle [mm]")
    legend_below(figure, panels[0], 2)
    return Drawing("errors", "Over time", "By the true poses; dotted: the study's limits.", figure)


def _over_time(
    axes: Axes, times: FloatArray, values: FloatArray, limit: float, least: float, label: str
) -> None:
    axes.plot(times, np.maximum(values, least), color=EXECUTED, label="camera")
    axes.axhline(limit, color=REQUIRED, ls=":", lw=1.6, label="limit")
    axes.set_yscale("log")
    axes.yaxis.set_major_formatter(FuncFormatter(lambda value, _: f"{value:g}"))
    axes.set_xlabel("time [s]")
    axes.set_ylabel(label)


def _gaps(scene: StudyScene, trajectory: Trajectory) -> FloatArray:
    """Return how far the camera's centre is from the nearest obstacle's surface at each time (k,) [m]."""
    centres, gaps = trajectory.centres, np.full(len(trajectory.times), np.inf)
    for times, balls in scene.phases(trajectory.times):
        for ball in balls:
            gap = np.linalg.norm(centres[times] - ball.center, axis=1) - ball.radius
            gaps[times] = np.minimum(gaps[times], gap)
    return gaps


def _html(study: Study, row: StudyRow, drawings: list[Drawing], planned: bool) -> str:
    carried = "" if row.arm == "none" else f" on {row.arm}"
    title = f"Row {row.row} of study {study.name}"
    ended = f"{row.status}{': ' if row.reason else ''}{row.reason}".replace("_", " ", 1)
    said = "Success. " if row.success else "Collision. " if row.collision else "No success. "
    body: list[Markup] = [
        banner(title, f"{row.method} with the camera {row.camera}{carried}"),
        judged(row.success, tag("strong", said), ended),
        part("Figures", tag("div", *(framed(drawing, "wide") for drawing in drawings), class_="figures")),
        part("The row", table(["", ""], _lines(row))),
    ]
    if planned:
        words = "plan.json beside this page is the certified plan: omniservo verify plan.json judges it."
        body.append(part("The plan", tag("p", words)))
    return page(title, body)


def _lines(row: StudyRow) -> list[list[str]]:
    return [[_label(name), _said(name, value)] for name, value in fields_of_row(row).items()]


def _label(name: str) -> str:
    """Return a field's name in words, without the unit that stands behind its value."""
    stem, _, unit = name.rpartition("_")
    return (stem if stem and unit in _UNITS else name).replace("_", " ")


def _said(name: str, value: object) -> str:
    if value is None:
        return NOTHING
    if isinstance(value, bool):
        return "yes" if value else "no"
    unit = _UNITS.get(name.rpartition("_")[2]) if "_" in name else None
    unit = "s" if name == "seconds" else unit
    if isinstance(value, float) and unit is not None:
        return spell(value, unit)
    return f"{value:.3f}" if isinstance(value, float) else str(value)
