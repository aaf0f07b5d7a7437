"""What is false is refuted, however small the lie."""

import copy
import json

import numpy as np
import pytest
from sampled_plans import camera, camera_points, path, plan, problem, project, ridge, slack, true_margins
from scipy.spatial.transform import Rotation

from omniservo.verification import PlanFileError, verify_plan

DETOUR = (0.06, 0.0, 0.0)


@pytest.fixture(scope="module")
def certified():
    asked = problem(
        occlusion=True,
        obstacles=[
            {"type": "sphere", "center": [-0.03, -0.065, 0.085], "radius": 0.01},
            {"type": "sphere", "center": [-0.005, -0.08, 0.09], "radius": 0.0},
        ],
        workspace={
            "min": [-0.1, -0.2, -0.1],
            "max": [0.2, 0.1, 0.3],
            "half_spaces": [
                {"normal": [0.0, 0.6, 0.8], "offset": -0.05},
                {"normal": [-0.6, 0, 0.8 + 5e-7], "offset": -0.3},
            ],
        },
    )
    document = plan(asked, path(asked, DETOUR))
    assert verify_plan(document).status == "certified"
    return document


@pytest.fixture
def honest(certified):
    """A certified plan, free to be changed."""
    return copy.deepcopy(certified)


def refuted(document, *words):
    answer = verify_plan(document)
    assert answer.status == "refuted"
    assert answer.reasons
    for word in words:
        assert any(word in reason for reason in answer.reasons), answer.reasons
    return answer


def test_each_dropped_constraint_is_missed(honest):
    lines = honest["certificate"]["constraints"]
    for k in range(len(lines)):
        changed = copy.deepcopy(honest)
        dropped = changed["certificate"]["constraints"].pop(k)
        refuted(changed, dropped["name"], "missing")


def test_each_overstated_margin_is_found(honest):
    truth = true_margins(honest["problem"], honest["path"])
    for k, line in enumerate(honest["certificate"]["constraints"]):
        changed = copy.deepcopy(honest)
        margin = truth[line["name"]][0]
        changed["certificate"]["constraints"][k]["margin"] = margin + 1e-9 * abs(margin)
        refuted(changed, line["name"])


def test_unknown_repeated_and_misnamed_lines_are_refused(honest):
    lines = honest["certificate"]["constraints"]
    for extra in (
        {"name": "beauty", "margin": 0.0, "unit": "1", "w": 0.5},
        {"name": "clearance obstacle 7", "margin": 0.0, "unit": "m", "w": 0.5},
        lines[0],
    ):
        changed = copy.deepcopy(honest)
        changed["certificate"]["constraints"].append(extra)
        refuted(changed, extra["name"])
    changed = copy.deepcopy(honest)
    changed["certificate"]["constraints"][0]["unit"] = "mm"
    refuted(changed, "mm")


def test_a_line_about_a_point_that_there_is_not_is_refused(honest):
    points = len(honest["problem"]["points"])
    for point, expected in ((points - 1, "certified"), (points, "refuted")):
        changed = copy.deepcopy(honest)
        line = next(c for c in changed["certificate"]["constraints"] if c["name"] == "domain")
        line["name"] = f"domain (point {point})"
        assert verify_plan(changed).status == expected


@pytest.mark.parametrize("more", [1.0, 1e3, 1e9])
def test_a_margin_beyond_the_whole_circle_of_the_largest_angle_is_refused(honest, more):
    changed = copy.deepcopy(honest)
    for line in changed["certificate"]["constraints"]:
        if line["name"] == "visibility max_angle":
            line["margin"] = 350.0 * more
    refuted(changed, "visibility max_angle")


@pytest.mark.parametrize("relative", [1e-3, 1e-6, 1e-9])
def test_violation_planted_between_samples_is_found(relative):
    # t passes a sphere whose radius exceeds the true least distance by a relative 1e-9 for |w − w₀| < 3e-5.
    asked = problem(
        obstacles=[{"type": "sphere", "center": [-0.0103, -0.0651, 0.0853], "radius": 0.0}], clearance=0.0
    )
    way = path(asked, DETOUR)
    squared = np.zeros(1)
    for row, x in zip(way["translation"], asked["obstacles"][0]["center"], strict=True):
        offset = np.polysub(row, [x])
        squared = np.polyadd(squared, np.polymul(offset, offset))
    stationary = [r.real for r in np.roots(np.polyder(squared)) if abs(r.imag) < 1e-12 and 0 < r.real < 1]
    least = min(float(np.sqrt(np.polyval(squared, w))) for w in stationary)
    margins = {name: m - slack(m) for name, (m, _, _) in true_margins(asked, way).items()}
    margins["clearance obstacle 0"] = 0.0
    asked["clearance"] = least * (1 - relative)
    assert verify_plan(plan(asked, way, margins)).status == "certified"
    asked["clearance"] = least * (1 + relative)
    answer = refuted(plan(asked, way, margins), "clearance obstacle 0")
    witness = next(j.w for j in answer.constraints if j.name == "clearance obstacle 0")
    assert min(abs(witness - w) for w in stationary) < 2 * np.sqrt(relative)


def test_standing_still_and_ending_elsewhere_are_refuted(honest):
    still = copy.deepcopy(honest)
    still["path"] = {"rotation": [[0.0], [0.0], [0.0], [1.0]], "translation": [[0.0]] * 3}
    refuted(still, "path end")
    for row in range(3):
        moved = copy.deepcopy(honest)
        moved["path"]["translation"][row][1] += 2e-9
        refuted(moved, "path end")
        late = copy.deepcopy(honest)
        late["path"]["translation"][row][2] += 2e-9
        refuted(late, "path start")
        turned = copy.deepcopy(honest)
        turned["path"]["rotation"][row][1] += 2e-9
        refuted(turned, "path end")


def test_end_within_1e_9_is_accepted(honest):
    honest["path"]["translation"][0][1] += 0.9e-9
    honest["path"]["rotation"][1][1] += 0.4e-9
    assert verify_plan(honest).status == "certified"


def test_degree_beyond_the_allowed_is_refuted(honest):
    honest["path"]["translation"] = [[0.0, *row] for row in honest["path"]["translation"]]
    refuted(honest, "degree 3")


def test_rotation_through_zero_is_refuted():
    asked = problem()
    way = path(asked, DETOUR)
    way["rotation"][3] = [8.0, -8.0, 1.0]  # 1 at both ends, −1 in the middle
    margins = {name: max(0.0, m - slack(m)) for name, (m, _, _) in true_margins(asked, way).items()}
    refuted(plan(asked, way, margins), "rotation")


def test_status_must_be_true(honest):
    refuted({**honest, "status": "refuted"}, "satisfies every constraint")
    refuted({**honest, "status": "infeasible"}, "both end poses satisfy every constraint")
    refuted({**honest, "status": "splendid"}, "status")
    asked = problem()
    refuted(
        plan(asked, path(asked), dict.fromkeys(true_margins(asked, path(asked)), 0.0)), "clearance obstacle 0"
    )


@pytest.mark.parametrize(
    ("change", "says"),
    [
        ({"obstacles": [{"type": "sphere", "center": [0.0, 0.0, 0.03], "radius": 0.0}]}, "start: clearance"),
        ({"obstacles": [{"type": "sphere", "center": [0.0, -0.1, 0.22], "radius": 0.0}]}, "goal: clearance"),
        ({"points": [*ridge(), [0.0, 0.0, -0.5]]}, "start: domain"),
        ({"points": [*ridge(), [0.0, 1.2, 0.3]]}, "start: visibility bottom edge (point 9)"),
        ({"points": [*ridge(), [0.0, 0.0, 0.01]]}, "start: least_distance"),
        ({"workspace": {"min": [-1.0] * 3, "max": [1.0, 1.0, 0.1]}}, "goal: workspace z max"),
        (
            {"workspace": {"half_spaces": [{"normal": [0.0, 0.0, -1.0], "offset": -0.1}]}},
            "goal: workspace half-space 0",
        ),
        (
            {
                "obstacles": [{"type": "sphere", "center": [0.0, -0.04, 0.2], "radius": 0.02}],
                "occlusion": True,
            },
            "start: occlusion obstacle 0",
        ),
    ],
)
def test_infeasible_is_confirmed_at_an_end_pose(change, says):
    asked = problem(**change)
    document = {"format": "omniservo.plan/1", "problem": asked, "status": "infeasible", "path": None}
    answer = refuted(document, "infeasible confirmed at the " + says)
    assert len(answer.reasons) == 1


def test_point_behind_the_camera_that_folds_into_the_image_is_refuted():
    lens = camera("fisheye") | {"max_angle": None}
    behind = np.array([np.sin(np.radians(172.0)), 0.0, np.cos(np.radians(172.0))]) * 0.5
    pixel = project(lens, behind[None])[0][0]
    assert 0 < pixel[0] < lens["width"]
    assert 0 < pixel[1] < lens["height"]
    asked = problem(camera=lens, points=[*ridge(), behind.tolist()], obstacles=[])
    asked["goal"]["translation"] = [0.0, 0.0, 0.001]
    way = path(asked)
    margins = {name: max(0.0, m - slack(m)) for name, (m, _, _) in true_margins(asked, way).items()}
    assert min(m for name, m in margins.items() if name.startswith("visibility")) > 1
    answer = refuted(plan(asked, way, margins), "domain (point 9)")
    assert len(answer.reasons) == 1


def test_point_on_the_rim_of_the_domain_is_outside():
    lens = camera("perspective")
    asked = problem(camera=lens, points=[[0.25, 0.0, 0.5]], obstacles=[])
    asked["goal"] = {"translation": [0.0, 0.0, 0.5], "quaternion": [0.0, 0.0, 0.0, 1.0]}
    way = path(asked)
    names = true_margins(asked, way, samples=3)
    refuted(plan(asked, way, dict.fromkeys(names, -10.0)), "domain")


def test_no_point_is_farther_inside_the_domain_than_the_axis_is():
    asked = problem(camera=camera("perspective"), points=[[0.0, 0.0, 0.5]], obstacles=[])
    asked["goal"] = {"translation": [0.0, 0.0, 0.1], "quaternion": [0.0, 0.0, 0.0, 1.0]}
    way = path(asked)
    margins = {name: m - slack(m) for name, (m, _, _) in true_margins(asked, way).items()}
    assert verify_plan(plan(asked, way, margins)).status == "certified"
    for more in (1e-9, 0.1, 1.6, 3.2):
        refuted(plan(asked, way, {**margins, "domain": np.pi / 2 + more}), "domain")


def test_path_that_swings_out_of_view_between_its_ends_is_refuted():
    asked = problem(camera=camera("perspective"), obstacles=[], points=ridge(center=(0.0, 0.0, 0.8)))
    asked["goal"]["translation"] = [0.05, 0.0, 0.0]
    way = path(asked, (0.0, 0.0, 0.0), (0.0, 0.4, 0.0, 0.0))
    truth = true_margins(asked, way)
    lost = min((m for m in truth.items() if m[0].startswith("visibility")), key=lambda m: m[1][0])
    assert lost[1][0] < 0
    assert 0.2 < lost[1][1] < 0.8
    margins = {name: max(0.0, m - slack(m)) for name, (m, _, _) in truth.items()}
    refuted(plan(asked, way, margins), lost[0])


def test_obstacle_in_the_line_of_sight_is_refuted():
    asked = problem(
        obstacles=[{"type": "sphere", "center": [0.03, -0.08, 0.25], "radius": 0.012}],
        occlusion=True,
        clearance=0.0,
    )
    way = path(asked, DETOUR)
    truth = true_margins(asked, way)
    assert truth["clearance obstacle 0"][0] > 0 > truth["occlusion obstacle 0"][0]
    margins = {name: max(0.0, m - slack(m)) for name, (m, _, _) in truth.items()}
    refuted(plan(asked, way, margins), "occlusion obstacle 0 (point")
    asked["occlusion"] = False
    del margins["occlusion obstacle 0"]
    assert verify_plan(plan(asked, way, margins)).status == "certified"


def test_dead_zone_off_the_centre_is_refuted_where_the_path_enters_it():
    lens = camera("para-catadioptric")
    asked = problem(camera=lens, points=[[0.22, 0.03, 0.4]], obstacles=[])
    asked["goal"] = {"translation": [0.4, 0.0, 0.0], "quaternion": [0.0, 0.0, 0.0, 1.0]}
    way = path(asked)
    truth = true_margins(asked, way)
    assert truth["dead_zone"][0] < 0
    assert 0 < truth["dead_zone"][1] < 1
    assert min(m for name, (m, _, _) in truth.items() if name != "dead_zone") > 0
    margins = {name: max(0.0, m - slack(m)) for name, (m, _, _) in truth.items()}
    answer = refuted(plan(asked, way, margins), "dead_zone (point 0)")
    assert len(answer.reasons) == 1


def test_every_number_of_the_file_that_is_not_finite_is_refused(honest):
    def spoiled(node, bad):
        """Every copy of the document with one number replaced."""
        if isinstance(node, dict):
            for name, child in node.items():
                yield from ({**node, name: other} for other in spoiled(child, bad))
        elif isinstance(node, list):
            for i, child in enumerate(node):
                yield from ([*node[:i], other, *node[i + 1 :]] for other in spoiled(child, bad))
        elif isinstance(node, int | float) and not isinstance(node, bool):
            yield bad

    honest.pop("seconds")
    small = copy.deepcopy(honest)
    small["problem"]["points"] = small["problem"]["points"][:1]
    for bad in (float("nan"), float("inf"), "1", None):
        count = 0
        for document in spoiled(small, bad):
            if bad is None and document["certificate"] != small["certificate"]:
                continue  # "w": null says that the planner does not know
            if bad is None and document["problem"] != small["problem"]:
                continue  # "max_angle": null, "clearance": null are legal
            refuted(document)
            count += 1
        assert count > 10


@pytest.mark.parametrize(
    ("where", "given", "says"),
    [
        (("format",), "omniservo.plan/2", "omniservo.plan/1"),
        (("problem", "format"), "omniservo.problem/0", "omniservo.problem/1"),
        (("problem", "points"), [], "at least one"),
        (("problem", "points"), [[0, 0]], "3 numbers"),
        (("problem", "camera"), "camera.yaml", "an object with fields"),
        (("problem", "camera", "model"), "pinhole", "unified"),
        (("problem", "camera", "fx"), 0.0, "fx"),
        (("problem", "camera", "xi"), -0.1, ">= 0"),
        (("problem", "camera", "max_angle"), 4.0, "up to pi"),
        (("problem", "goal", "quaternion"), [0, 0, 0, 1.00001], "1e-6"),
        (("problem", "obstacles", 0, "radius"), -1.0, ">= 0"),
        (("problem", "clearance"), -1.0, ">= 0"),
        (("problem", "occlusion"), 1, "true, false"),
        (("problem", "degrees"), {"rotation": 2.9, "translation": 2}, "whole numbers"),
        (("problem", "workspace"), {"min": [0, 0, 0]}, "workspace.max"),
        (("problem", "workspace", "half_spaces", 0, "normal"), [0, 0, 1.1], "1e-6"),
        (("problem", "workspace", "half_spaces", 0, "offset"), None, "a number"),
        (("path",), None, "path"),
        (("path", "rotation"), [[0.0]] * 3, "4 rows"),
        (("path", "translation"), [[0.0] * 1001] * 3, "degree 1000"),
        (("certificate",), None, "certificate"),
        (("certificate", "constraints"), None, "a list"),
        (("certificate", "constraints", 0, "margin"), 10**400, "finite"),
        (("certificate", "constraints", 0, "w"), 1.5, "0 to 1"),
    ],
)
def test_missing_and_malformed_fields_are_named(honest, where, given, says):
    node = honest
    for key in where[:-1]:
        node = node[key]
    node[where[-1]] = given
    refuted(honest, says)


def test_what_this_verifier_does_not_know_is_undecided(honest):
    for change in (
        {"obstacles": [{"type": "mesh", "file": "a.stl"}]},
        {"image_mask": "mask.png"},
        {"camera": {**honest["problem"]["camera"], "k3": 0.1}},
    ):
        answer = verify_plan({**honest, "problem": {**honest["problem"], **change}})
        assert answer.status == "undecided"
        assert "does not" in answer.reasons[0]


def test_too_many_points_are_refused_before_any_work(honest):
    honest["problem"]["points"] = [[0.0, 0.0, 0.4]] * 1_000_000
    refuted(honest, "at most 100000")


@pytest.mark.parametrize(("off", "status"), [(0.9e-9, "certified"), (1.1e-9, "refuted")])
@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_the_end_meets_the_goal_within_a_nanometre_and_a_nanoradian(honest, off, status, sign):
    goal = honest["problem"]["goal"]
    turned = Rotation.from_quat(goal["quaternion"]) * Rotation.from_rotvec([0.0, off, 0.0])
    for fields in (
        {"quaternion": (sign * turned.as_quat()).tolist()},
        {"translation": [goal["translation"][0] + sign * off, *goal["translation"][1:]]},
    ):
        changed = copy.deepcopy(honest)
        changed["problem"]["goal"] |= fields
        answer = verify_plan(changed)
        assert answer.status == status, answer.reasons
        assert all(reason.startswith("path end (w = 1): ") for reason in answer.reasons)


def test_what_is_no_plan_at_all_is_an_error(tmp_path, honest):
    for document in ({}, [], 3, None, {"format": "omniservo.problem/1"}):
        with pytest.raises(PlanFileError, match="not a plan"):
            verify_plan(document)
    with pytest.raises(PlanFileError, match="no such file"):
        verify_plan(tmp_path / "none.json")
    with pytest.raises(PlanFileError, match="directory"):
        verify_plan(tmp_path)
    file = tmp_path / "plan.json"
    for text in ("", "{", "[" * 100_000, "\x00", '{"format": "a", "format": "b"}', "1" * 5000):
        file.write_text(text)
        with pytest.raises(PlanFileError, match=str(file.name)):
            verify_plan(file)
    file.write_bytes(b"\xff\xfe\xff")
    with pytest.raises(PlanFileError, match="not JSON"):
        verify_plan(file)
    with file.open("wb") as out:
        out.truncate(100 << 20)
    with pytest.raises(PlanFileError, match="at most"):
        verify_plan(file)
    file.write_text(json.dumps({**honest, "seconds": float("nan")}))
    assert verify_plan(file).status == "certified"  # the time that it took is no claim about the path


def test_reasons_give_the_point_that_the_reference_finds():
    asked = problem(camera=camera("perspective"), points=ridge(), obstacles=[])
    way = path(asked, DETOUR)
    truth = true_margins(asked, way)
    name, (margin, w, point) = min(truth.items(), key=lambda item: item[1][0])
    assert margin < 0
    c, _, _ = camera_points(way, asked["points"], np.array([w]))
    assert project(asked["camera"], c)[0].shape == (1, 9, 2)
    margins = {n: max(0.0, m - slack(m)) for n, (m, _, _) in truth.items()}
    reasons = refuted(plan(asked, way, margins), name).reasons
    assert any(f"(point {k})" in r for r in reasons for k in range(9))
    assert point is not None


def test_rotation_quaternion_order_is_scalar_last():
    turn = Rotation.from_euler("y", -25, degrees=True).as_quat(canonical=True)
    asked = problem(goal={"translation": [0.0, -0.1, 0.2], "quaternion": turn.tolist()}, obstacles=[])
    way = path(asked)
    way["rotation"] = way["rotation"][-1:] + way["rotation"][:-1]
    refuted(plan(asked, way, dict.fromkeys(true_margins(asked, way), -10.0)), "path start")
