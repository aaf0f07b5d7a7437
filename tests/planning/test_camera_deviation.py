"""A camera's pixels may lie off the true ones by so much: every image limit is kept with that in addition."""

import json

import numpy as np
import pytest
from scipy.spatial.transform import RigidTransform, Rotation

from omniservo.cameras import UnifiedCamera, preset
from omniservo.errors import InputError
from omniservo.planning import PlanningProblem, plan_path
from omniservo.verification import verify_plan

ASKED, DEVIATION = 2.0, 1.25
POINTS = np.array([[0.0, 0.0, 0.6], [0.1, 0.05, 0.55], [-0.1, 0.05, 0.65], [0.05, -0.1, 0.6]])
GOAL = RigidTransform.from_components([0.2, 0.0, 0.1], Rotation.from_rotvec([0.0, -0.3, 0.1]))
BLOCK = [[250.0, 250.0], [350.0, 250.0], [350.0, 300.0], [250.0, 300.0]]
DISTORTED = UnifiedCamera(500.0, 505.0, 320.0, 240.0, 0.9, 640, 480, distortion=(-0.1, 0.02, 1e-3, -5e-4))
LENSES = {
    "fisheye with its largest angle": preset("fe185"),
    "dead zone": UnifiedCamera(
        300.0, 300.0, 320.0, 240.0, 1.2, 640, 480, dead_zone={"center": [560.0, 60.0], "radius": 30.0}
    ),
    "mask": UnifiedCamera(300.0, 300.0, 320.0, 200.0, 1.2, 640, 480, mask=[BLOCK]),
    "distorted": DISTORTED,
}


def problem(camera: UnifiedCamera, margin: float = ASKED) -> PlanningProblem:
    return PlanningProblem(camera, POINTS, GOAL, visibility_margin=margin)


def off(camera: UnifiedCamera, deviation: float = DEVIATION) -> UnifiedCamera:
    return UnifiedCamera.from_dict(camera.to_dict() | {"deviation_px": deviation})


@pytest.mark.parametrize("name", LENSES)
def test_a_deviation_is_kept_as_a_margin_more(name):
    plan = plan_path(problem(off(LENSES[name])))
    other = plan_path(problem(LENSES[name], ASKED + DEVIATION))
    assert plan.status == other.status == "certified"
    margins, others = ({c.name: c.margin for c in p.certificate.constraints} for p in (plan, other))
    assert margins == pytest.approx(others, abs=1e-9)
    assert verify_plan(plan).status == "certified"


@pytest.mark.parametrize("name", LENSES)
def test_a_deviation_that_the_plan_did_not_keep_is_refuted(name):
    plan = plan_path(problem(LENSES[name]))
    document = json.loads(json.dumps(plan.to_dict()))
    assert verify_plan(document).status == "certified"
    least = min(c.margin for c in plan.certificate.constraints if c.name.startswith(("visibility", "dead")))
    document["problem"]["camera"]["deviation_px"] = least + 0.5
    answer = verify_plan(document)
    assert answer.status == "refuted"
    assert "visibility" in answer.reasons[0] or "dead_zone" in answer.reasons[0]


def test_a_deviation_that_leaves_no_image_is_said():
    with pytest.raises(InputError, match="2 px, and the camera's deviation of 300 px, given"):
        plan_path(problem(off(preset("fe185"), 300.0)))


def test_an_end_pose_within_the_deviation_of_the_border_is_infeasible():
    seen, _ = preset("fe185").project(POINTS)
    border = float(min(seen.min(), 658.5 - seen[:, 0].max(), 431.5 - seen[:, 1].max())) + 0.5
    plan = plan_path(problem(off(preset("fe185"), border - 1.0)))
    assert plan.status == "infeasible"
    assert "visibility" in plan.reason
    assert verify_plan(plan).reasons[0].startswith("infeasible confirmed")


@pytest.mark.parametrize("value", [-1.0, np.nan, np.inf, "1", True])
def test_a_deviation_is_a_finite_length(value):
    with pytest.raises(InputError, match="deviation_px"):
        off(preset("fe185"), value)


def test_a_deviation_of_zero_leaves_a_file_as_it_was():
    assert "deviation_px" not in preset("fe185").to_dict()
    assert off(preset("fe185"), 0.5).to_dict()["deviation_px"] == 0.5
