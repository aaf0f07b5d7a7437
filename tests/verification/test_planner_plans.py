"""The planner and the verifier share no code; they agree on every plan."""

import json

import numpy as np
import pytest
from sampled_plans import FE185, camera, problem, random_case

from omniservo.cameras import UnifiedCamera
from omniservo.planning import PlanningProblem, plan_path
from omniservo.verification import verify_plan

DISTORTED = {**FE185, "max_angle": None, "distortion": [-0.08, 0.02, 1e-3, -5e-4]}
LENSES = {
    "fisheye": FE185,
    "any angle": camera("fisheye, any angle"),
    "strong fisheye": camera("strong fisheye"),
    "distorted": DISTORTED,
    "distorted, largest angle": {**DISTORTED, "max_angle": 1.2},
    "distorted, dead zone": {**DISTORTED, "dead_zone": {"center": [330.0, 390.0], "radius": 20.0}},
}


@pytest.mark.parametrize("name", LENSES)
def test_planned_path_is_certified_from_its_saved_file(name, tmp_path):
    planned = plan_path(PlanningProblem.from_dict(problem(camera=LENSES[name], visibility_margin=2.0)))
    assert planned.status == "certified"
    planned.save(tmp_path / "plan.json")
    answer = verify_plan(tmp_path / "plan.json")
    assert answer.status == "certified", answer.reasons
    assert verify_plan(planned) == answer


def test_a_margin_larger_than_the_way_from_the_axis_to_an_edge_is_verified():
    lens = {**DISTORTED, "distortion": [-0.04, 0.006, 8e-4, -5e-4]}
    ray = UnifiedCamera.from_dict(lens).unproject([330.0, 215.0])[0]
    goal = {"translation": (0.05 * ray).tolist(), "quaternion": [0, 0, 0, 1]}
    asked = problem(camera=lens, points=[(0.4 * ray).tolist()], goal=goal, obstacles=[])
    planned = plan_path(PlanningProblem.from_dict(asked))
    margins = {c.name.split(" (")[0]: c.margin for c in planned.certificate.constraints}
    assert margins["visibility polygon"] > 431.5 - lens["cy"]
    assert verify_plan(planned).status == "certified", verify_plan(planned).reasons


@pytest.mark.parametrize(
    ("xi", "angle"), [(0.0, np.pi / 2 - 1e-9), (0.0, 1.7), (0.8, 2.6), (1.0, np.pi)], ids=str
)
def test_a_largest_angle_that_ends_beyond_the_image_is_verified(xi, angle):
    """At the domain's end its circle is infinite on the plane: a margin of ∞ px was never proven."""
    lens = {**FE185, "fx": 300.0 * (1.0 + xi), "fy": 300.0 * (1.0 + xi), "xi": xi, "max_angle": angle}
    goal = {"translation": [0.05, 0.02, 0.1], "quaternion": [0, 0, 0, 1]}
    points = [[x, y, 0.6] for x in (-0.1, 0.1) for y in (-0.1, 0.1)]
    planned = plan_path(PlanningProblem.from_dict(problem(camera=lens, points=points, goal=goal)))
    assert planned.status == "certified", planned.reason
    assert verify_plan(planned).status == "certified", verify_plan(planned).reasons


def test_random_problems_are_answered_alike():
    rng = np.random.default_rng(3)
    agreed = {"certified": 0, "infeasible": 0}
    for _ in range(40):
        asked, _ = random_case(rng)
        planned = plan_path(PlanningProblem.from_dict(asked))
        answer = verify_plan(planned)
        if planned.status == "certified":
            assert answer.status == "certified", answer.reasons
            agreed["certified"] += 1
        elif planned.status == "infeasible":
            assert answer.reasons[0].startswith("infeasible confirmed"), answer.reasons
            agreed["infeasible"] += 1
        else:
            assert answer.status != "certified"
    assert min(agreed.values()) > 5


def test_sampled_search_of_the_paper_is_judged_like_any_other():
    planned = plan_path(PlanningProblem.from_dict(problem()), method="paper")
    assert (verify_plan(planned).status == "certified") == (planned.status == "certified")


def test_changed_planner_plans_are_refuted():
    rng = np.random.default_rng(8)
    document = json.loads(json.dumps(plan_path(PlanningProblem.from_dict(problem())).to_dict()))
    assert verify_plan(document).status == "certified"
    for _ in range(60):
        changed = json.loads(json.dumps(document))
        row = changed["path"][str(rng.choice(["rotation", "translation"]))]
        i, k = rng.integers(len(row)), rng.integers(len(row[0]))
        row[i][k] += float(rng.choice([-1, 1]) * 10 ** rng.uniform(-8, 0))
        if i == 3 and len(row) == 4:
            continue  # the identity's own component only stretches the quaternion
        answer = verify_plan(changed)
        assert answer.status == "refuted"
