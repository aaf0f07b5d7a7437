"""The figures: written, of the run they claim to show, and drawn with what the run has."""

from dataclasses import replace
from itertools import pairwise

import matplotlib as mpl
import numpy as np
import pytest
from PIL import Image

from omniservo.reporting import write_figures
from omniservo.reporting.figure_files import image_bytes
from omniservo.reporting.joint_figures import executed_speed_shares
from omniservo.reporting.margins import arm_gap, clearance
from omniservo.reporting.path_3d import path_3d
from omniservo.reporting.promise_words import CERTIFIED
from omniservo.reporting.style import Drawing, new_axes, styled
from omniservo.reporting.trajectories import image_trajectories, plane_trajectories
from omniservo.reporting.write_figures import drawings
from omniservo.results.run_log import RunLog
from omniservo.tasks import load_task

EVERY = {
    "views", "outside", "path-3d", "virtual-plane", "image", "translation", "rotation", "clearance",
    "link-clearance", "arm-gap", "visibility", "image-error", "camera-twist", "joint-velocities",
    "joint-positions", "joint-speeds",
}  # fmt: skip
OF_A_PLAN = {"link-clearance", "joint-positions", "joint-speeds"}


@pytest.fixture(scope="module")
def drawn(run):
    return {drawing.name: drawing for drawing in drawings(run)}


def one(draw, run):
    """One of a run's figures."""
    with styled():
        return draw(run)


@pytest.mark.slow
def test_every_figure_is_written_as_png_and_svg(run, tmp_path):
    written = write_figures(run, tmp_path)
    assert {p.stem for p in written if p.suffix == ".png"} == EVERY
    assert {p.stem for p in written if p.suffix == ".svg"} == EVERY
    for path in written:
        if path.suffix == ".png":
            with Image.open(path) as picture:
                assert picture.size[0] > 600
                assert len(picture.convert("RGB").getcolors(2**24)) > 10
        else:
            assert "<svg" in path.read_text()[:2000]


def test_figures_do_not_touch_matplotlibs_settings(run):
    before = dict(mpl.rcParams)
    image_bytes(next(drawings(run)), "png")
    assert dict(mpl.rcParams) == before


def test_names_in_figures_are_no_formulas_whatever_a_user_has_set_matplotlib_to():
    """Names of joints and files with dollars in them, and settings in which scientists write papers."""
    with mpl.rc_context({"text.usetex": True, "axes.formatter.use_mathtext": True}):
        with styled():
            figure, axes = new_axes(3.0, 2.0)
            axes.plot([0.0, 1e-7], [0.0, 1e9], label="link $\\frac$")
            axes.set_title("joint a$^$b")
            axes.legend()
        assert len(image_bytes(Drawing("name", "", "", figure), "svg")) > 1000


@pytest.mark.slow
def test_a_figure_is_drawn_once_for_its_pixels_and_once_for_its_lines(run, monkeypatch):
    drawing, draws = next(drawings(run)), []
    once = type(drawing.figure).draw

    def counted(figure, renderer):
        draws.append(renderer)
        once(figure, renderer)

    monkeypatch.setattr(type(drawing.figure), "draw", counted)
    for ending in ("png", "svg", "webp", "png"):
        assert image_bytes(drawing, ending)
    assert len(draws) == 2


def test_equal_runs_give_equal_files(made_up_run):
    def once():
        drawing = one(clearance, made_up_run())
        return image_bytes(drawing, "svg"), image_bytes(drawing, "png")

    assert once() == once()


@pytest.mark.slow
def test_different_runs_give_different_figures(drawn, made_up_run):
    other = made_up_run("paper-example-2")
    for draw in (path_3d, image_trajectories, clearance):
        drawing = one(draw, other)
        assert image_bytes(drawn[drawing.name], "png") != image_bytes(drawing, "png"), drawing.name


def test_every_axis_has_a_unit(drawn):
    for name in EVERY - {"views", "outside"}:
        for axes in drawn[name].figure.axes:
            shared = axes.get_shared_x_axes().get_siblings(axes)
            assert any("[" in a.get_xlabel() for a in shared), name
            assert "[" in axes.get_ylabel(), name


@pytest.mark.slow
@pytest.mark.parametrize("task", ["paper-example-2", "ur5e-table"])
def test_no_words_of_a_figure_overlap_or_leave_it(made_up_run, task):
    found = list(drawings(made_up_run(task)))
    assert {drawing.name for drawing in found} == EVERY
    for drawing in found:
        figure = drawing.figure
        figure.draw_without_rendering()
        page = figure.bbox
        for legend in figure.legends:
            box = legend.get_window_extent()
            assert box.x0 > page.x0 - 1, drawing.name
            assert box.x1 < page.x1 + 1, drawing.name
        for axes in figure.axes:
            for text in (axes.xaxis.label, axes.yaxis.label, axes.title):
                box = text.get_window_extent()
                inside = box.x0 > page.x0 - 1 and box.x1 < page.x1 + 1 and box.y1 < page.y1 + 1
                assert inside or not text.get_text(), (drawing.name, text.get_text())
            if axes.name != "3d":
                ticks = [t.get_window_extent() for t in axes.xaxis.get_majorticklabels() if t.get_text()]
                assert all(a.x1 <= b.x0 for a, b in pairwise(ticks)), drawing.name


def test_a_run_without_a_plan_shows_what_was_executed(made_up_run):
    names = {d.name for d in drawings(made_up_run(method="ibvs"))}
    assert names == EVERY - OF_A_PLAN


def test_a_run_stopped_before_its_first_step_still_has_its_plan_and_pictures(stopped_run):
    names = {d.name for d in drawings(stopped_run)}
    assert {"views", "outside", "path-3d", "virtual-plane", "image", "clearance", "visibility"} <= names
    assert not names & {
        "arm-gap",
        "link-clearance",
        "image-error",
        "camera-twist",
        "joint-velocities",
        "translation",
        "rotation",
    }


def test_a_run_of_one_step_can_be_drawn(made_up_run):
    assert {d.name for d in drawings(made_up_run(steps=1))} == EVERY


def test_lost_dots_are_gaps_and_not_lines(made_up_run):
    lossy = made_up_run(steps=12)
    for row in lossy.log.rows[4:8]:
        row.pixels[2] = np.nan
        row.valid[2] = False
    drawing = one(image_trajectories, lossy)
    line = [x for x in drawing.figure.axes[0].lines if len(x.get_xdata()) == 12][2]
    assert np.isnan(line.get_xdata()).sum() == 4


def test_the_caption_says_how_many_dots_the_virtual_plane_cannot_show(made_up_run):
    behind = made_up_run(steps=5)
    camera = behind.task.camera
    pixel, valid = camera.project(np.array([np.sin(1.6), 0.0, np.cos(1.6)]))
    assert valid
    for row in behind.log.rows[:3]:
        row.pixels[0] = pixel
    assert "3 of 45" in one(plane_trajectories, behind).caption


def test_a_contact_is_drawn_on_tinted_ground(made_up_run):
    def grounds(run):
        return len(one(arm_gap, run).figure.axes[0].patches)

    touching = made_up_run(steps=8)
    rows = [replace(row, arm_clearance=-0.002 if k == 5 else 0.01) for k, row in enumerate(touching.log.rows)]
    assert grounds(touching) == 0
    assert grounds(replace(touching, log=RunLog(rows))) == 1


def test_the_certified_bound_is_drawn_only_for_a_certified_plan(run, drawn):
    def labels(drawing):
        return {line.get_label() for line in drawing.figure.axes[0].lines}

    assert CERTIFIED in labels(drawn["clearance"])
    assert CERTIFIED in labels(drawn["visibility"])


def test_the_caption_says_what_the_planner_was_given_of_the_obstacle(made_up_run):
    def caption(run):
        return one(path_3d, run).caption

    def given(obstacles):
        planning = points.task.planning.model_copy(update={"obstacles": obstacles})
        return replace(points, task=points.task.model_copy(update={"planning": planning}))

    points, box = made_up_run(), load_task("whole-arm-1").planning.obstacles
    assert "real body, for which these points or balls stand." in caption(points)
    assert "real body, which is stated as a body." in caption(given(box))
    assert "obstacle" not in caption(given(()))


def test_executed_joint_speeds_are_those_between_the_times_at_which_the_joints_were_read(run):
    late = np.random.default_rng(0).uniform(0.0, 0.09, len(run.log.rows))
    rows = [
        replace(row, read_time=row.time + by, joints=(row.time + by) * np.arange(6.0))
        for row, by in zip(run.log.rows, late, strict=True)
    ]
    rows.insert(4, replace(rows[4], time=rows[4].time - 1e-3))  # no joints were read between two images
    _, shares = executed_speed_shares(RunLog(rows), run.motion)
    np.testing.assert_allclose(
        shares, np.arange(6.0) / run.motion.arm.joint_speed * np.ones((len(shares), 1))
    )
