"""The way on from an estimate: a plan among stated obstacles, and a picture where it is refused."""

import json
import re
from pathlib import Path

import numpy as np
import pytest
from PIL import Image
from tests.cli.calling import call

from omniservo.cameras import preset
from omniservo.estimation import TwoViewEstimate, estimate_two_view
from omniservo.planning import Plan, PlanningProblem, plan_path, worst_moment

PAGE = Path(__file__).resolve().parents[2] / "docs" / "estimation.md"
OBSTACLES, COMMANDS = re.search(
    r"<!-- estimate-to-plan -->\n```yaml\n(.*?)```.*?```bash\n(.*?)```", PAGE.read_text(), re.DOTALL
).groups()
CAMERA = preset("fe185")
GOAL = np.array([0.0, -0.1, 0.2])
POINTS = np.array([[x, y - 0.08, 0.4 - 0.8 * abs(x)] for x in (-0.08, 0.0, 0.08) for y in (-0.06, 0.0, 0.06)])


def test_the_commands_of_the_documentation_lead_from_two_pictures_to_a_verified_plan(
    capsys, tmp_path, monkeypatch
):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "obstacles.yaml").write_text(OBSTACLES)
    for line in COMMANDS.splitlines():
        code, _, _ = call(capsys, *line.split()[1:], "--quiet")
        assert code == 0
    estimate, plan = TwoViewEstimate.load("estimate.json"), Plan.load("plan.json")
    assert plan.problem.camera == estimate.camera
    np.testing.assert_allclose(plan.problem.points, estimate.points[estimate.inliers])
    np.testing.assert_allclose(plan.problem.goal_translation, estimate.initial_T_goal.translation)
    assert plan.least_clearance([0]) >= 0.05
    assert not Path("plan.png").exists()


@pytest.fixture
def estimate(tmp_path):
    """An estimate's file: nine points without noise, and the camera."""
    here = CAMERA.project(POINTS)[0]
    there = CAMERA.project(POINTS - GOAL)[0]
    random = np.random.default_rng(0)
    found = estimate_two_view(CAMERA, here, there + 0.01 * random.standard_normal(there.shape), scale=0.2236)
    fields = {**found.to_dict(), "camera": CAMERA.to_dict()}
    (tmp_path / "estimate.json").write_text(json.dumps(fields))
    return tmp_path / "estimate.json"


def obstacles(estimate, **changed):
    fields = {
        "format": "omniservo.obstacles/1",
        "obstacles": [{"type": "sphere", "center": [0, 0, 0.03], "radius": 0.01}],
        "clearance": 0.05,
    }
    path = estimate.with_name("obstacles.json")
    path.write_text(json.dumps({k: v for k, v in (fields | changed).items() if v is not None}))
    return path


def test_a_refused_plan_is_drawn_beside_it(capsys, estimate):
    out = estimate.with_name("plan.json")
    code, _, err = call(
        capsys, "plan", "--estimate", estimate, "--obstacles", obstacles(estimate), "--out", out, "--quiet"
    )
    assert code == 1
    assert "the start pose (w = 0) violates clearance obstacle 0" in err
    picture = np.asarray(Image.open(out.with_suffix(".png")).convert("RGB")).astype(int)
    named = (picture[..., 0] > 190) & (picture[..., 1] < 170) & (abs(picture[..., 1] - picture[..., 2]) < 40)
    assert named.mean() > 1e-3  # the obstacle that is named stands out
    worst = worst_moment(Plan.load(out))
    assert (worst.name, worst.unit, worst.w) == ("clearance obstacle 0", "m", 0.0)
    np.testing.assert_allclose(worst.margin, 0.03 - 0.01 - 0.05, atol=1e-9)


def test_the_moment_that_is_drawn_is_the_one_with_least_left():
    problem = PlanningProblem.from_dict(
        {
            "format": "omniservo.problem/1",
            "camera": CAMERA.to_dict(),
            "points": POINTS.tolist(),
            "goal": {"translation": GOAL.tolist(), "quaternion": [0, 0, 0, 1]},
            "obstacles": [{"type": "box", "center": [0, -0.05, 0.1], "quaternion": [0, 0, 0, 1],
                           "half_extents": [0.01, 0.01, 0.01]}],
            "clearance": 0.03,
        }
    )  # fmt: skip
    plan = plan_path(problem)
    worst = worst_moment(plan)
    w = np.linspace(0.0, 1.0, 2001)
    gaps = problem.obstacles[0].distance(plan.path(w).translation) - 0.03
    assert worst.name == "clearance obstacle 0"
    assert abs(w[gaps.argmin()] - worst.w) < 0.01


BAD = {
    "no obstacles": ([], {}, {}, "it goes with a PROBLEM, or with --obstacles"),
    "no scale": (["--obstacles"], {}, {"is_metric": False}, "is_metric: false given; obstacles are"),
    "no camera": (["--obstacles"], {}, {"camera": None}, "camera: missing"),
    "another format": (["--obstacles"], {"format": "omniservo.problem/1"}, {}, "legal: 'omniservo.obs"),
    "a goal of its own": (["--obstacles"], {"goal": {}}, {}, "obstacles.json: goal: no such field"),
    "no format": (["--obstacles"], {"format": None}, {}, "obstacles.json: format: missing"),
    "a negative clearance": (["--obstacles"], {"clearance": -1}, {}, "obstacles.json: clearance: -1"),
    "drawn as text": (["--draw", "moment.txt", "--obstacles"], {}, {}, "--draw: moment.txt given; legal:"),
}


@pytest.mark.parametrize("fault", BAD)
def test_what_cannot_be_planned_with_is_one_message(capsys, estimate, fault):
    options, changed, fields, wanted = BAD[fault]
    estimate.write_text(json.dumps({**json.loads(estimate.read_text()), **fields}))
    given = [*options, obstacles(estimate, **changed)] if options else []
    code, out, err = call(capsys, "plan", "--estimate", estimate, *given, "--quiet")
    assert (code, out, len(err.splitlines())) == (2, "", 1)
    assert wanted in err


@pytest.mark.parametrize(
    ("flag", "value"), [("--obstacles", "o.json"), ("--clearance", "1"), ("--risk", "0.1")]
)
def test_what_belongs_to_an_estimate_is_refused_without_one(capsys, tmp_path, flag, value):
    (tmp_path / "o.json").write_text("{}")
    code, _, err = call(capsys, "plan", flag, tmp_path / value if flag == "--obstacles" else value, "--quiet")
    assert code == 2
    assert f"{flag} given without --estimate" in err


def test_photographs_without_dots_are_told_what_else_there_is(capsys, tmp_path):
    grey = np.random.default_rng(0).integers(0, 255, (CAMERA.height, CAMERA.width)).astype(np.uint8)
    for name in ("a.png", "b.png"):
        Image.fromarray(grey // 8 + 100).save(tmp_path / name)
    images = ("--camera", "fe185", "--initial", tmp_path / "a.png", "--goal", tmp_path / "b.png", "--quiet")
    code, _, err = call(capsys, "estimate", *images)
    assert code == 2
    assert "dots found; at least 8 are needed" in err
    assert "natural (--features natural)" in err
    code, _, err = call(capsys, "estimate", *images, "--features", "tags")
    assert code == 2
    assert "dictionary: missing; tags need one, as --dictionary tag36h11" in err
