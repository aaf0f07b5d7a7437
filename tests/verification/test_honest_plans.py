"""What is true is certified: every camera, every constraint, touching included."""

import json
from types import SimpleNamespace

import numpy as np
import pytest
from sampled_plans import CAMERAS, camera, path, plan, problem, ridge, true_margins
from scipy.spatial.transform import Rotation

from omniservo.verification import Certificate, verify_plan

DETOUR = (0.06, 0.0, 0.0)


def certified(document):
    answer = verify_plan(document)
    assert answer.status == "certified", answer.reasons
    assert answer.reasons == ()
    assert {j.verdict for j in answer.constraints} == {"holds"}
    return answer


def test_paper_example_with_a_detour_is_certified():
    asked = problem()
    answer = certified(plan(asked, path(asked, DETOUR)))
    assert [j.name for j in answer.constraints] == [
        "clearance obstacle 0",
        "clearance obstacle 1",
        "rotation",
        "domain",
        "visibility left edge",
        "visibility right edge",
        "visibility top edge",
        "visibility bottom edge",
        "visibility max_angle",
        "least_distance",
    ]


def test_straight_path_of_the_paper_example_is_refuted_where_it_is_closest():
    asked = problem()
    straight = path(asked)
    margins = {name: max(0.0, m - 1e-3) for name, (m, _, _) in true_margins(asked, straight).items()}
    answer = verify_plan(plan(asked, straight, margins))
    assert answer.status == "refuted"
    truth, where, _ = true_margins(asked, straight)["clearance obstacle 0"]
    said = next(r for r in answer.reasons if r.startswith("clearance obstacle 0"))
    amount, w = float(said.split()[3]), float(said.split("w = ")[1].split(",")[0])
    assert amount == pytest.approx(truth, abs=1e-4)
    assert w == pytest.approx(where, abs=0.02)


@pytest.mark.parametrize("name", CAMERAS)
@pytest.mark.parametrize("angle", [0.0, 25.0, 60.0])
def test_every_camera_certifies_a_turning_path(name, angle):
    turn = Rotation.from_euler("y", -angle, degrees=True)
    goal = {"translation": [-0.1, 0.02, -0.05], "quaternion": turn.as_quat(canonical=True).tolist()}
    lens = camera(name)
    if lens["dead_zone"] is not None:
        lens["dead_zone"]["radius"] = 1.5
    # Ahead of the camera half way; a mirror sees the same points reflected.
    targets = ridge(center=(0.1, 0.1, 0.5), step=(0.02, 0.02), depth=0.01)
    asked = problem(camera=lens, points=targets, goal=goal, clearance=0.02)
    way = path(asked, (0.03, 0.01, 0.0), (0.01, -0.02, 0.0, 0.02))
    lowest = min(true_margins(asked, way).values())[0]
    if lowest > 0:
        certified(plan(asked, way))
    else:
        assert verify_plan(plan(asked, way)).status == "refuted"


def test_targets_past_ninety_degrees_are_certified():
    lens = camera("para-catadioptric") | {"dead_zone": None, "width": 4000, "height": 4000, "cx": 2000.0}
    lens["cy"] = 2000.0
    asked = problem(camera=lens, points=ridge(center=(0.6, 0.1, -0.35)), obstacles=[])
    answer = certified(plan(asked, path(asked, DETOUR)))
    limit = next(j for j in answer.constraints if j.name == "domain").margin
    assert limit < np.pi - np.radians(100)


def test_path_with_the_other_sign_of_the_quaternion_is_the_same_path():
    asked = problem()
    way = path(asked, DETOUR)
    way["rotation"] = (-np.array(way["rotation"])).tolist()
    certified(plan(asked, way))


def test_goal_quaternion_of_the_other_sign_or_length_within_1e_6_is_the_same_goal():
    asked = problem()
    way = path(asked, DETOUR)
    asked["goal"]["quaternion"] = [0.0, 0.0, 0.0, -(1 + 9e-7)]
    certified(plan(asked, way))


def test_clearance_that_only_touches_is_certified():
    # The straight path passes at exactly 0.25 m, nearest at w = 1/3: no binary fraction.
    asked = problem(
        goal={"translation": [0.75, 0.0, 0.0], "quaternion": [0.0, 0.0, 0.0, 1.0]},
        points=[[0.4, 0.1, 3.0]],
        obstacles=[{"type": "sphere", "center": [0.25, 0.25, 0.0], "radius": 0.125}],
        clearance=0.125,
    )
    way = path(asked)
    margins = {name: max(0.0, m - 1e-6) for name, (m, _, _) in true_margins(asked, way).items()}
    margins["clearance obstacle 0"] = 0.0
    certified(plan(asked, way, margins))
    margins["clearance obstacle 0"] = 1e-20
    assert verify_plan(plan(asked, way, margins)).status == "refuted"


def test_margins_that_are_looser_than_the_truth_are_true():
    asked = problem()
    way = path(asked, DETOUR)
    certified(plan(asked, way, dict.fromkeys(true_margins(asked, way), 0.0)))
    certified(plan(asked, way, dict.fromkeys(true_margins(asked, way), -0.25)))


def test_names_may_say_which_point_is_lowest():
    asked = problem()
    document = plan(asked, path(asked, DETOUR))
    for line in document["certificate"]["constraints"]:
        if line["name"].split()[0] in ("visibility", "domain", "least_distance"):
            line["name"] += " (point 3)"
    certified(document)
    document["certificate"]["constraints"][-1]["name"] = "least_distance (point 9)"
    assert verify_plan(document).status == "refuted"


def test_occlusion_workspace_and_own_clearance_are_certified():
    asked = problem(
        obstacles=[
            {"type": "sphere", "center": [-0.12, -0.065, 0.085], "radius": 0.03, "clearance": 0.01},
            {"type": "sphere", "center": [-0.005, -0.2, 0.09], "radius": 0.0},
        ],
        occlusion=True,
        workspace={
            "min": [-0.1, -0.2, -0.1],
            "max": [0.2, 0.1, 0.3],
            "half_spaces": [{"normal": [0.0, 0.6, 0.8], "offset": -0.3}],
        },
    )
    answer = certified(plan(asked, path(asked, DETOUR)))
    names = [j.name for j in answer.constraints]
    assert "occlusion obstacle 0" in names
    assert "occlusion obstacle 1" not in names  # a point hides nothing
    assert "workspace z max" in names


def test_half_space_is_linear_and_exact():
    asked = problem(
        obstacles=[{"type": "half_space", "normal": [0.6, 0.0, 0.8], "offset": -0.5}], clearance=0.0
    )
    way = path(asked, DETOUR)
    w = np.linspace(0, 1, 20_001)
    t = np.array([np.polyval(row, w) for row in way["translation"]]).T
    margin = float((t @ [0.6, 0, 0.8] + 0.5).min())
    margins = {
        name: m - 1e-6 * (1 + m) for name, (m, _, _) in true_margins({**asked, "obstacles": []}, way).items()
    }
    certified(plan(asked, way, {**margins, "clearance obstacle 0": margin - 1e-9}))
    assert (
        verify_plan(plan(asked, way, {**margins, "clearance obstacle 0": margin + 1e-9})).status == "refuted"
    )


def test_higher_degrees_are_judged():
    asked = problem(degrees={"rotation": 3, "translation": 5})
    way = path(asked, DETOUR, (0.02, 0.01, 0.0, 0.03))
    way["translation"] = [
        [*bump, *row] for bump, row in zip([[0.1, -0.1, 0.0]] * 3, way["translation"], strict=True)
    ]
    for row, goal in zip(way["translation"], asked["goal"]["translation"], strict=True):
        row[-2] += goal - sum(row)
    way["rotation"] = [[0.0, *row] for row in way["rotation"]]
    certified(plan(asked, way))


def test_optional_fields_have_the_documented_defaults():
    asked = problem(clearance=0.0, least_distance=1e-3)
    for name in ("clearance", "least_distance", "visibility_margin", "occlusion", "degrees"):
        del asked[name]
    certified(plan(asked, path(asked, DETOUR)))


def test_path_to_a_file_and_object_with_to_dict_are_read(tmp_path):
    asked = problem()
    document = plan(asked, path(asked, DETOUR))
    file = tmp_path / "plan.json"
    file.write_text(json.dumps(document))
    assert certified(str(file)) == certified(file) == certified(SimpleNamespace(to_dict=lambda: document))


@pytest.mark.parametrize("status", ["undecided", "not_found"])
def test_plan_that_claims_less_is_judged_by_its_path(status):
    asked = problem()
    certified(plan(asked, path(asked, DETOUR), status=status))
    document = plan(asked, path(asked), status=status)
    document["certificate"] = None
    answer = verify_plan(document)
    assert answer.status == "refuted"
    assert any(reason.startswith("clearance") for reason in answer.reasons)


def test_answer_becomes_plain_json():
    asked = problem()
    answer = verify_plan(plan(asked, path(asked)))
    assert isinstance(answer, Certificate)
    assert json.loads(json.dumps(answer.to_dict()))["status"] == "refuted"
