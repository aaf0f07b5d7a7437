"""The separating planes of boxes and capsules: believed only as far as they separate."""

import copy

import numpy as np
import pytest
from sampled_plans import path, problem

from omniservo.planning import PlanningProblem, plan_path
from omniservo.verification import verify_plan

BOX = {
    "type": "box",
    "center": [0.03, -0.075, 0.1],
    "quaternion": [0.0, 0.0, 0.0, 1.0],
    "half_extents": [0.06, 0.01, 0.02],
}
CAPSULE = {"type": "capsule", "from": [-0.07, -0.12, 0.12], "to": [-0.07, 0.0, 0.1], "radius": 0.015}


def planned():
    asked = problem(obstacles=[BOX, CAPSULE], clearance=0.01, occlusion=True)
    document = plan_path(PlanningProblem.from_dict(asked)).to_dict()
    assert document["status"] == "certified"
    return document


@pytest.fixture(scope="module")
def first():
    document = planned()
    answer = verify_plan(document)
    assert answer.status == "certified", answer.reasons
    return document


@pytest.fixture
def honest(first):
    return copy.deepcopy(first)


def refuted(document, *words):
    answer = verify_plan(document)
    assert answer.status == "refuted", answer
    for word in words:
        assert any(word in reason for reason in answer.reasons), answer.reasons


def longest(document):
    """The separator with the most pieces: its constraint is tight."""
    return max(document["certificate"]["separators"], key=lambda s: len(s["pieces"]))


def by_hand(box, normal, pieces=((0.0, 1.0),), **changes):
    """A straight path along y, 0.1 long, beside a box; one plane a piece."""
    goal = {"translation": [0.0, 0.125, 0.0], "quaternion": [0.0, 0.0, 0.0, 1.0]}
    asked = problem(points=[[0.0, 0.0, 0.5]], goal=goal, obstacles=[box], clearance=0.0, **changes)
    way = path(asked)
    separators = [
        {"constraint": "clearance obstacle 0", "pieces": [[a, b, *normal] for a, b in pieces]},
    ]
    document = {
        "format": "omniservo.plan/1",
        "problem": asked,
        "status": "certified",
        "path": {k: np.asarray(v).tolist() for k, v in way.items()},
        "certificate": {"constraints": [], "separators": separators},
    }
    return document, [r for r in verify_plan(document).reasons if "is missing" not in r]


WALL = {"type": "box", "center": [0.5, 0.0, 0.0], "quaternion": [0, 0, 0, 1], "half_extents": [0.25, 1, 1]}


def test_a_plane_by_hand_proves_whatever_its_length():
    for length in (1.0, 1e-3, 77.0):
        assert by_hand(WALL, [-length, 0.0, 0.0])[1] == []


def test_touching_is_allowed_and_the_least_overlap_is_not():
    touching = {**WALL, "half_extents": [0.5, 1, 1]}
    assert by_hand(touching, [-1.0, 0.0, 0.0])[1] == []
    overlapping = {**WALL, "half_extents": [0.5 + 1e-15, 1, 1]}
    assert "clearance obstacle 0" in by_hand(overlapping, [-1.0, 0.0, 0.0])[1][0]


def test_the_clearance_of_a_skew_plane_is_measured_along_its_normal():
    turned = {**WALL, "quaternion": [0.0, 0.0, np.sin(np.pi / 8), np.cos(np.pi / 8)]}
    turned["half_extents"] = [0.05, 0.05, 1.0]
    assert by_hand({**turned, "clearance": 0.4}, [-1.0, 0.0, 0.0])[1] == []
    assert "clearance obstacle 0" in by_hand({**turned, "clearance": 0.45}, [-1.0, 0.0, 0.0])[1][0]


@pytest.mark.parametrize(
    "normal", [[1.0, 0.0, 0.0], [0.0, 0.0, 0.0], [0.0, 1.0, 0.0], [-1.0, 5.0, 0.0], [-1.0, -5.0, 0.0]]
)
def test_a_plane_that_does_not_separate_is_refused_though_the_path_is_free(normal):
    assert "does not separate" in by_hand(WALL, normal)[1][0]


@pytest.mark.parametrize(
    "pieces",
    [
        [],
        [(0.0, 0.5)],
        [(0.5, 1.0)],
        [(0.0, 0.5), (0.75, 1.0)],
        [(0.0, 0.5), (0.5 + 2**-52, 1.0)],
        [(0.5, 1.0), (0.0, 0.5)],
        [(0.0, 0.75), (0.5, 1.0)],
        [(0.0, 1.0 - 2**-53)],
        [(2**-1074, 1.0)],
        [(0.0, 1.0), (0.5, 1.0)],
    ],
)
def test_pieces_that_leave_a_gap_or_overlap_are_refused(pieces):
    assert "no plane at w" in by_hand(WALL, [-1.0, 0.0, 0.0], pieces)[1][0]


def test_pieces_need_not_be_dyadic():
    assert by_hand(WALL, [-1.0, 0.0, 0.0], [(0.0, 0.1), (0.1, 1 / 3), (1 / 3, 1.0)])[1] == []


@pytest.mark.parametrize("place", range(5))
def test_every_vertex_of_a_mesh_counts_wherever_it_stands_in_the_list(place):
    block = [[0.3, 0.0, 0.0], [0.5, 0.2, 0.0], [0.5, 0.0, 0.2], [0.6, 0.1, 0.1]]
    for x, faults in ((0.01, 0), (-0.01, 1)):
        vertices = [*block[:place], [x, 0.05, 0.02], *block[place:]]
        assert len(by_hand({"type": "mesh", "vertices": vertices}, [-1.0, 0.0, 0.0])[1]) == faults


SCREEN = {
    "type": "box",
    "center": [0, 0.06, 0.25],
    "quaternion": [0, 0, 0, 1],
    "half_extents": [0.1, 0.1, 0.05],
}
CORNERS = [[x, 0.06 + y, 0.25 + z] for x in (-0.1, 0.1) for y in (-0.1, 0.1) for z in (-0.05, 0.05)]
SCREENS = {
    "box": SCREEN,
    "capsule": {"type": "capsule", "from": [-0.1, 0.06, 0.25], "to": [0.1, 0.06, 0.25], "radius": 0.05},
    "mesh": {"type": "mesh", "vertices": CORNERS},
    "moving box": {**SCREEN, "center": [0, 0.06, 0.3], "motion": [[0.0, 0.0], [0.0, 0.0], [0.02, -0.05]]},
}


@pytest.mark.parametrize("body", SCREENS)
def test_a_plane_that_keeps_only_the_camera_off_hides_no_screen_before_the_target(body):
    """The body stands across the lines of sight, clear of the path: the planes of its clearance are true."""
    document, clear = by_hand(SCREENS[body], [0.0, 0.0, -1.0])
    assert clear == []
    document["problem"]["occlusion"] = True
    planes = document["certificate"]["separators"]
    planes.append({**planes[0], "constraint": "occlusion obstacle 0", "point": 0})
    reasons = verify_plan(document).reasons
    assert any(reason.startswith("occlusion obstacle 0 (point 0): ") for reason in reasons), reasons
    # beside the sights the same kind of plane, turned, proves both
    aside = {**SCREEN, "center": [0.5, 0.06, 0.25]}
    document, clear = by_hand(aside, [-1.0, 0.0, 0.0], occlusion=True)
    planes = document["certificate"]["separators"]
    planes.append({**planes[0], "constraint": "occlusion obstacle 0", "point": 0})
    assert not any("occlusion" in r and "is missing" not in r for r in verify_plan(document).reasons)


def test_each_missing_separator_is_missed(honest):
    separators = honest["certificate"]["separators"]
    for k in range(len(separators)):
        changed = copy.deepcopy(honest)
        del changed["certificate"]["separators"][k]
        refuted(changed, "certificate.separators", "is missing")
    del honest["certificate"]["separators"]
    refuted(honest, "certificate.separators")
    honest["status"] = "undecided"
    assert verify_plan(honest).status == "undecided"


def test_planes_for_a_point_that_there_is_not_are_refused(honest):
    separators = honest["certificate"]["separators"]
    one = next(s for s in separators if s["constraint"].startswith("occlusion"))
    for point in (len(honest["problem"]["points"]), -1):
        changed = copy.deepcopy(honest)
        changed["certificate"]["separators"].append({**copy.deepcopy(one), "point": point})
        refuted(changed, "is no constraint of this problem")


def test_changed_normals_are_refused(honest):
    count = len(longest(honest)["pieces"])
    for k in range(count):
        changed = copy.deepcopy(honest)
        row = longest(changed)["pieces"][k]
        row[2:] = (-np.array(row[2:])).tolist()
        refuted(changed, "does not separate")
    for k in range(count):
        changed = copy.deepcopy(honest)
        del longest(changed)["pieces"][k]
        refuted(changed)


def test_an_overstated_margin_is_refused(honest):
    for k, line in enumerate(honest["certificate"]["constraints"]):
        if line["name"].startswith(("clearance", "occlusion")):
            changed = copy.deepcopy(honest)
            changed["certificate"]["constraints"][k]["margin"] += 1.5e-3
            refuted(changed, line["name"].split(" (")[0])


def test_a_grown_or_moved_obstacle_is_noticed(honest):
    for index, key, k in ((0, "half_extents", 1), (0, "center", 1), (1, "from", 1), (1, "to", 1)):
        changed = copy.deepcopy(honest)
        changed["problem"]["obstacles"][index][key][k] += 0.05
        refuted(changed, f"obstacle {index}")
    honest["problem"]["obstacles"][1]["radius"] += 0.05
    refuted(honest, "obstacle 1")


@pytest.mark.parametrize(
    ("change", "says"),
    [
        ({"constraint": "clearance obstacle 2"}, "is no constraint of this problem"),
        ({"constraint": "clearance obstacle 00"}, "is no constraint of this problem"),
        ({"constraint": "workspace x min"}, "is no constraint of this problem"),
        ({"point": 0}, "is no constraint of this problem"),
        ({"constraint": 3}, "must be text"),
        ({"point": 0.5}, "whole number"),
        ({"pieces": [[0.0, 1.0, 1.0, 0.0]]}, "5 numbers are needed"),
        ({"pieces": [[0.0, 1.5, 1.0, 0.0, 0.0]]}, "0 <= from < to <= 1"),
        ({"pieces": [[0.5, 0.5, 1.0, 0.0, 0.0]]}, "0 <= from < to <= 1"),
        ({"pieces": [[0.0, 1.0, float("nan"), 0.0, 0.0]]}, "finite number"),
        ({"pieces": 7}, "a list is needed"),
        ({"constraint": "clearance obstacle 1"}, "stands twice"),
    ],
)
def test_a_malformed_separator_is_refused(honest, change, says):
    separator = honest["certificate"]["separators"][0]
    assert separator["constraint"] == "clearance obstacle 0"
    separator.update(change)
    refuted(honest, says)


def test_a_separator_with_more_fields_is_not_judged(honest):
    honest["certificate"]["separators"][0]["offset"] = 1.0
    assert verify_plan(honest).status == "undecided"


@pytest.mark.parametrize(
    "obstacle",
    [
        {**BOX, "half_extents": [0.05, 0.0, 0.02]},
        {**BOX, "quaternion": [0.0, 0.0, 0.0, 1.1]},
        {**CAPSULE, "radius": 0.0},
        {**CAPSULE, "to": [0.0, 0.0]},
    ],
)
def test_a_malformed_obstacle_is_refused(honest, obstacle):
    honest["problem"]["obstacles"][0] = obstacle
    refuted(honest, "problem.obstacles[0]")


def test_very_many_planes_are_not_judged(honest):
    rows = [[0.0, 1.0, 1.0, 0.0, 0.0]] * 120_000
    for separator in honest["certificate"]["separators"][:2]:
        separator["pieces"] = rows
    assert "more than 200000 planes" in verify_plan(honest).reasons[0]
