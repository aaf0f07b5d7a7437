"""A problem takes a camera of any model: planned with its unified form, whose residual is a margin."""

import json

import numpy as np
import pytest
from benchmarks.lens_conversions import PUBLISHED
from scipy.spatial.transform import RigidTransform, Rotation

from omniservo.camera_files import save_camera
from omniservo.cameras import preset
from omniservo.cameras.conversion import to_unified
from omniservo.cameras.models import DoubleSphere, Equirectangular
from omniservo.errors import InputError
from omniservo.planning import PlanningProblem, plan_path
from omniservo.verification import verify_plan

T265 = PUBLISHED["RealSense T265, fisheye"]
POINTS = np.array([[0.0, 0.0, 0.6], [0.1, 0.05, 0.55], [-0.1, 0.05, 0.65], [0.05, -0.1, 0.6]])
GOAL = RigidTransform.from_components([0.2, 0.0, 0.1], Rotation.from_rotvec([0.0, -0.3, 0.1]))


@pytest.mark.parametrize("name", PUBLISHED)
def test_what_is_certified_with_the_unified_form_is_seen_by_the_camera_itself(name):
    lens = PUBLISHED[name]
    problem = PlanningProblem(lens, POINTS, GOAL, visibility_margin=3.0)
    plan = plan_path(problem)
    assert plan.status == verify_plan(plan).status == "certified"
    assert problem.image_margin >= 3.0 + to_unified(lens).residual.largest_px
    points = np.concatenate([plan.path(w).inv().apply(POINTS) for w in np.linspace(0.0, 1.0, 101)])
    pixels, valid = lens.project(points)
    assert valid.all()
    size = np.array([lens.width, lens.height])
    assert np.minimum(pixels + 0.5, size - 0.5 - pixels).min() > 3.0


def test_a_notice_says_what_the_conversion_costs():
    assert PlanningProblem(T265, POINTS, GOAL).notices == (to_unified(T265).cost,)
    assert "at most 3.87 px (1.57 deg) away, rms 2.87 px; they keep 3.87 px more" in to_unified(T265).cost
    for exact in (preset("fe185"), DoubleSphere(200.0, 200.0, 320.0, 240.0, 0.0, 0.6, 640, 480)):
        assert PlanningProblem(exact, POINTS, GOAL).notices == ()


def test_a_file_states_the_camera_s_fields_or_its_calibration_in_any_model(tmp_path):
    fields = {
        "format": "omniservo.problem/1",
        "camera": T265.to_dict(),
        "points": POINTS.tolist(),
        "goal": {"translation": [0.2, 0.0, 0.1], "rotation_vector": [0.0, -0.3, 0.1]},
    }
    stated = PlanningProblem.from_dict(fields)
    assert stated.camera == to_unified(T265).camera
    assert stated.notices == (to_unified(T265).cost,)
    save_camera(T265, tmp_path / "camera.yaml", "ros")
    (tmp_path / "problem.json").write_text(json.dumps({**fields, "camera": "camera.yaml"}))
    loaded = PlanningProblem.load(tmp_path / "problem.json")
    assert loaded.camera.distortion == stated.camera.distortion
    assert loaded.notices == stated.notices
    again = PlanningProblem.from_dict(loaded.to_dict())
    assert again.camera == loaded.camera, "a plan's problem has the unified form"
    with pytest.raises(InputError, match=r"problem: camera: model: 'pinhol' given; legal: unified, kannala"):
        PlanningProblem.from_dict({**fields, "camera": {**T265.to_dict(), "model": "pinhol"}})


def test_a_conversion_that_leaves_no_image_is_said():
    with pytest.raises(InputError, match="the camera's deviation of [0-9.]+ px, given"):
        plan_path(PlanningProblem(Equirectangular(800, 400), POINTS, GOAL))
    with pytest.raises(InputError, match="camera: str given; a camera of any model is needed"):
        PlanningProblem("fe185", POINTS, GOAL)
