"""A plan is compared with the problem that was meant, field by field."""

import copy
import json

import numpy as np
import pytest
import sampled_plans
from scipy.spatial.transform import Rotation

from omniservo.verification import PlanFileError, verify_plan

BODIES = [
    {"type": "sphere", "center": [0.0, 0.3, 0.1], "radius": 0.02, "clearance": 0.01},
    {"type": "half_space", "normal": [0.0, 0.6, 0.8], "offset": -2.0},
    {"type": "cloud", "points": [[0.0, 0.4, 0.0], [0.1, 0.4, 0.0]], "radius": 0.01},
]


@pytest.fixture(scope="module")
def case():
    """A certified plan and its problem."""
    constraints = {"clearance": 0.02, "visibility_margin": 1.0, "least_distance": 1e-3}
    asked = sampled_plans.problem(obstacles=copy.deepcopy(BODIES), **constraints)
    path = sampled_plans.path(asked, (0.03, 0.0, 0.0), (0.01, 0.02, 0.0, 0.01))
    margins = sampled_plans.true_margins(asked, path)
    lines = {name: margin - sampled_plans.slack(margin) for name, (margin, _, _) in margins.items()}
    document = json.loads(json.dumps(sampled_plans.plan(asked, path, lines)))
    answer = verify_plan(document)
    assert (answer.status, answer.differences) == ("certified", None), answer.reasons
    return document


def changed(problem, place, value):
    """A copy of a problem with one field replaced; None takes it away."""
    copied = copy.deepcopy(problem)
    holder = copied
    for step in place[:-1]:
        holder = holder[step]
    if value is None:
        del holder[place[-1]]
    else:
        holder[place[-1]] = value
    return copied


def test_a_plan_for_the_problem_that_was_meant_is_certified(case, tmp_path):
    meant = copy.deepcopy(case["problem"])
    answer = verify_plan(case, problem=meant)
    assert (answer.status, answer.differences, answer.reasons) == ("certified", (), ())
    assert answer.to_dict()["differences"] == []
    (tmp_path / "plan.json").write_text(json.dumps(case))
    (tmp_path / "problem.json").write_text(json.dumps(meant))
    assert verify_plan(tmp_path / "plan.json", problem=tmp_path / "problem.json") == answer


CHANGES = [
    (("camera", "fx"), 301.0, "camera.fx"),
    (("camera", "distortion"), [0, 0, 1e-9, 0], "camera.distortion"),
    (("camera", "deviation_px"), 0.5, "camera.deviation_px"),
    (("camera", "mask"), [[[0, 0], [9, 0], [0, 9]]], "camera.mask[0]"),
    (("camera", "dead_zone"), {"center": [9.0, 9.0], "radius": 3.0}, "camera.dead_zone"),
    (("points", 0), [0.1, 0.1, 0.51], "points[0]"),
    (("points", 1, 2), 0.123, "points[1]"),
    (("goal", "translation"), [0.1, 0.0, 0.0], "goal.translation"),
    (("goal", "quaternion"), Rotation.from_rotvec([1e-8, 0, 0]).as_quat().tolist(), "goal.quaternion"),
    (("obstacles", 0, "radius"), 0.021, "obstacles[0].radius"),
    (("obstacles", 0, "clearance"), None, "obstacles[0].clearance"),
    (("obstacles", 0), {"type": "cloud", "points": [[9, 9, 9]], "radius": 0.1}, "obstacles[0]"),
    (("obstacles", 1, "normal"), [0.0, 0.8, 0.6], "obstacles[1].normal"),
    (("obstacles", 1, "normal"), [0.0, -0.6, -0.8], "obstacles[1].normal"),
    (("obstacles", 2, "points", 1), [0.1, 0.4, 1e-12], "obstacles[2].points[1]"),
    (("obstacles", 2, "motion"), [[1e-3, 0.0]] * 3, "obstacles[2].motion"),
    (("clearance",), 0.03, "obstacles[1].clearance"),
    (("least_distance",), 0.002, "least_distance"),
    (("visibility_margin",), 1.0000001, "visibility_margin"),
    (("occlusion",), True, "occlusion"),
    (("workspace",), {"min": [-1, -1, -1], "max": [1, 1, 1]}, "workspace.min"),
    (("workspace",), {"half_spaces": [{"normal": [0, 0, 1], "offset": -3}]}, "workspace.half_spaces[0]"),
    (("degrees",), {"rotation": 3, "translation": 2}, "degrees.rotation"),
    (("initial_velocity",), [0.0] * 6, "initial_velocity"),
]


@pytest.mark.parametrize(("place", "value", "name"), CHANGES)
def test_every_field_that_differs_is_named_with_both_values(case, place, value, name):
    meant = changed(case["problem"], place, value)
    answer = verify_plan(case, problem=meant)
    assert answer.status == "refuted"
    assert answer.differences[0].field == name
    found = answer.to_dict()["differences"][0]
    assert found["field"] == name
    assert found["plan"] != found["problem"]
    assert answer.reasons[0].startswith(f"problem.{name}: ")
    # and the other way round: the plan is the one that was changed
    other = verify_plan({**case, "problem": meant}, problem=case["problem"])
    if other.differences is not None:
        backwards = {(d.field, str(d.problem), str(d.plan)) for d in other.differences}
        assert backwards == {(d.field, str(d.plan), str(d.problem)) for d in answer.differences}


@pytest.mark.parametrize("normal", ["up", [0.0, 0.0], [10**400]])
def test_what_stands_in_a_field_that_no_proof_reads_is_only_compared(case, normal):
    document = changed(case, ("problem", "camera", "model_error"), {"normal": normal})
    assert verify_plan(document, problem=document["problem"]).status == "certified"
    meant = changed(document["problem"], ("camera", "model_error"), {"normal": 1})
    (found,) = verify_plan(document, problem=meant).differences
    assert found.field == "camera.model_error.normal"


def test_a_missing_or_surplus_obstacle_and_point_is_named(case):
    fewer = changed(case["problem"], ("obstacles", 2), None)
    found = verify_plan(case, problem=fewer).differences
    assert [(d.field, d.problem) for d in found] == [("obstacles[2]", None)]
    fewer = changed(case["problem"], ("points", -1), None)
    (only,) = verify_plan(case, problem=fewer).differences
    assert only.field == f"points[{len(case['problem']['points']) - 1}]"
    none = {**case["problem"], "obstacles": []}
    assert len(verify_plan(case, problem=none).differences) >= 3


def test_another_spelling_of_the_same_problem_is_no_difference(case):
    meant = copy.deepcopy(case["problem"])
    turned = np.array(meant["goal"]["quaternion"])
    meant["goal"]["quaternion"] = (-(1 + 5e-7) * turned).tolist()
    meant["obstacles"][1]["normal"] = (np.array([0.0, 0.6, 0.8]) * (1 - 3e-7)).tolist()
    meant["obstacles"][1]["clearance"] = 0.02
    meant["obstacles"][2] |= {"clearance": 0.02, "motion": None}
    meant["clearance"] = 0.02
    del meant["least_distance"]
    meant |= {"workspace": None, "initial_velocity": None, "occlusion": False}
    meant["degrees"] = {"rotation": 2}
    meant["camera"] |= {"skew": 0, "mask": None, "deviation_px": 0.0, "dead_zone": None}
    meant["camera"]["width"] = float(meant["camera"]["width"])
    assert verify_plan(case, problem=meant).differences == ()
    # each obstacle says its own clearance: what the problem says for the others means nothing
    for o in meant["obstacles"]:
        o["clearance"] = o.get("clearance") or 0.02
    assert verify_plan(case, problem={**meant, "clearance": 0.7}).differences == ()


CUBE = [[x, y, z] for x in (0.1, 0.3) for y in (0.3, 0.5) for z in (0.0, 0.2)]


@pytest.mark.parametrize(
    ("more", "same"),
    [
        (CUBE, True),
        ([[0.2, 0.4, 0.1], [0.1, 0.33, 0.17]], True),  # inside, on a face
        ([[0.2, 0.4, 0.2 + 1e-11]], False),
        ([[0.4, 0.4, 0.1]], False),
    ],
)
def test_vertices_inside_a_meshs_hull_need_not_stand_in_the_plan(case, more, same):
    plan = changed(case, ("problem", "obstacles"), [{"type": "mesh", "vertices": CUBE}])
    meant = changed(plan["problem"], ("obstacles", 0, "vertices"), more + CUBE)
    assert (verify_plan(plan, problem=meant).differences == ()) == same
    # what the plan has beyond what is meant is a difference wherever it lies
    other = verify_plan(changed(plan, ("problem",), meant), problem=plan["problem"])
    assert (other.differences == ()) == (more is CUBE)


def test_many_differences_are_all_held_and_the_first_are_said(case):
    meant = copy.deepcopy(case["problem"])
    meant["points"] += [[0.0, 0.0, 0.5 + 0.001 * k] for k in range(70)]
    answer = verify_plan(case, problem=meant)
    assert len(answer.differences) == 70
    assert "problem: 20 more fields differ" in answer.reasons


@pytest.mark.parametrize(
    ("meant", "message"),
    [
        ({}, "not a problem"),
        ([], "not a problem"),
        ({"format": "omniservo.problem/2"}, "problem.format"),
        ({"format": "omniservo.problem/1", "camera": "lens.yaml"}, "problem.camera: a path given"),
        ({"format": "omniservo.problem/1", "camera": {}}, "problem.goal"),
    ],
)
def test_what_is_no_problem_is_said(case, meant, message):
    with pytest.raises(PlanFileError, match=message):
        verify_plan(case, problem=meant)


def test_a_malformed_plan_is_refuted_before_it_is_compared(case):
    answer = verify_plan({**case, "problem": {}}, problem=case["problem"])
    assert (answer.status, answer.differences) == ("refuted", None)
