"""Cameras, estimates, plans, runs and calibrations show themselves: an image and a few numbers."""

import base64
import io
import re
import subprocess
import sys
from dataclasses import replace

import numpy as np
import pytest
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from PIL import Image
from tests.cli.test_command_line import problem
from tests.cli.test_first_contact import METRICS
from tests.project.test_arrays_of_results import RESULTS

import omniservo
from omniservo.cameras import PRESETS
from omniservo.cameras.models import KannalaBrandt
from omniservo.errors import InputError
from omniservo.reporting.values import _of_plan

LENS = KannalaBrandt(35, 35, 79.5, 59.5, 160, 120, k=(0, 0, 0, 0), max_angle=1.9)


def rows(html):
    """What the table says, by its names."""
    return dict(re.findall(r"<th[^>]*>(.*?)</th><td[^>]*>(.*?)</td>", html))


def image_of(html):
    (data,) = re.findall(r'src="data:image/webp;base64,([^"]+)"', html)
    return np.asarray(Image.open(io.BytesIO(base64.b64decode(data))).convert("L"))


@pytest.fixture(scope="module")
def plan():
    return omniservo.plan_path(omniservo.PlanningProblem.from_dict(problem(clearance=0.028)))


SHOWN = {
    "two views": RESULTS["two views"],
    "pose": RESULTS["pose"],
    "three views": RESULTS["three views"],
    "calibration": RESULTS["calibration"],
    "camera": lambda: PRESETS["hyper-catadioptric"],
    "another model": lambda: LENS,
}


@pytest.mark.slow
@pytest.mark.parametrize("kind", SHOWN)
def test_a_value_shows_a_small_image_and_about_five_numbers(kind):
    html = SHOWN[kind]()._repr_html_()
    assert 5 <= len(rows(html)) <= 6
    assert len(html) < 150_000
    assert image_of(html).std() > 3.0  # something is drawn
    assert "<script" not in html
    assert "nan" not in " ".join(rows(html).values())


def test_a_plan_shows_its_status_and_what_is_least(plan):
    html = plan._repr_html_()
    said = rows(html)
    assert said["status"] == "certified"
    assert said["clearance"] == "≥ 28.00 mm"
    assert said["tightest"].startswith("clearance obstacle 0")
    assert image_of(html).std() > 3.0


@pytest.mark.parametrize("clearance", [0.0279951, 0.0279999])
def test_what_is_said_of_a_certified_plan_is_proven_however_it_is_rounded(clearance):
    plan = omniservo.plan_path(omniservo.PlanningProblem.from_dict(problem(clearance=clearance)))
    said = dict(_of_plan(plan)[0])
    for name, proven in (
        ("clearance", 1e3 * plan.least_clearance([0])),
        ("points to the image's limits", plan.least_visibility()),
    ):
        bound, number, _ = said[name].split()
        assert bound == "≥"
        assert proven - 1.0 < float(number) <= proven
    assert "≥" not in dict(_of_plan(replace(plan, status="undecided"))[0])["clearance"]


def test_a_long_reason_stands_whole_over_a_plan_s_figure(plan):
    reason = "what would help: " + "; or ".join(["a calibration from more pictures"] * 8)
    figure = replace(plan, status="not_found", path=None, certificate=None, reason=reason).plot()
    canvas = FigureCanvasAgg(figure)
    canvas.draw()
    title = figure._suptitle
    assert " ".join(title.get_text().split("\n")) == f"not_found: {reason}"
    assert title.get_window_extent().x1 < figure.bbox.x1


def test_a_run_shows_its_path_and_how_it_ended(run):
    result = replace(run, metrics=METRICS)
    said = rows(result._repr_html_())
    assert said["task, method"] == "paper-example-1, certified"
    assert said["ended"].startswith("converged: 0.0406 mm")
    assert said["clearance, executed"] == "64.98 mm"
    assert isinstance(result.show(), Figure)
    assert repr(result).startswith("RunResult(paper-example-1, certified, converged, ")
    assert len(repr(result)) < 120


def test_what_has_no_answer_says_why_and_what_is_text_is_escaped():
    ball = {"type": "sphere", "center": [0.2, 0, 0.1], "radius": 0.01}
    refused = omniservo.plan_path(omniservo.PlanningProblem.from_dict(problem(obstacles=[ball])))
    assert rows(refused._repr_html_())["status"].startswith("infeasible: the goal pose")
    few = np.full((3, 2), 300.0)
    estimate = omniservo.estimate_two_view(PRESETS["fe185"], few, few)
    said = rows(estimate._repr_html_())
    assert said["status"].startswith("too_few_points")
    with pytest.raises(InputError, match="nothing to draw"):
        estimate.plot()
    marked = omniservo.TwoViewEstimate.without_pose(3, "ambiguous", "<b>bold</b>", 0.0)
    assert "&lt;b&gt;bold" in marked._repr_html_()


def test_figures_are_matplotlibs_own_and_belong_to_no_window(plan):
    figures = [plan.plot(), PRESETS["fe185"].plot_field(), LENS.plot_field(), RESULTS["two views"]().plot()]
    assert all(isinstance(figure, Figure) for figure in figures)
    picture = Image.open(io.BytesIO(figures[0]._repr_png_()))
    assert picture.size[0] > 600
    assert not any(hasattr(figure, "number") for figure in figures)  # what pyplot gives its own


@pytest.mark.slow
def test_nothing_is_loaded_for_values_that_no_one_looks_at():
    code = (
        "import omniservo, sys\n"
        "camera = omniservo.preset('fe185'); repr(camera)\n"
        "print('matplotlib' in sys.modules, 'omniservo.reporting' in sys.modules)"
    )
    ended = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert ended.stdout.split() == ["False", "False"]
