"""Obstacles that move by a polynomial in w: what holds, holds for t − m and h − m."""

import copy

import numpy as np
import pytest
from sampled_plans import path, plan, problem, slack, true_margins

from omniservo.planning import PlanningProblem, plan_path
from omniservo.verification import verify_plan

DETOUR = (0.06, 0.0, 0.0)
BOX = {
    "type": "box",
    "center": [0.03, -0.075, 0.1],
    "quaternion": [0.0, 0.0, 0.0, 1.0],
    "half_extents": [0.06, 0.01, 0.02],
}
CAPSULE = {"type": "capsule", "from": [-0.07, -0.12, 0.12], "to": [-0.07, 0.0, 0.1], "radius": 0.015}


def random_motion(rng, degree):
    return (rng.normal(size=(3, degree + 1)) * 0.08).tolist()


@pytest.mark.parametrize("seed", range(3))
def test_random_moving_spheres_half_spaces_and_clouds_are_judged_as_sampling_judges_them(seed):
    rng = np.random.default_rng(seed)
    seen = {"certified": 0, "refuted": 0}
    for _ in range(25):
        degree = int(rng.integers(0, 5))
        kinds = [
            {"type": "sphere", "center": (rng.normal(size=3) * 0.2).tolist(), "radius": 0.02},
            {"type": "half_space", "normal": [0.0, 0.6, -0.8], "offset": float(rng.uniform(-0.5, -0.2))},
            {"type": "cloud", "points": (rng.normal(size=(20, 3)) * 0.25).tolist(), "radius": 0.004},
        ]
        moving = {**kinds[rng.integers(3)], "motion": random_motion(rng, degree), "clearance": 0.01}
        asked = problem(obstacles=[moving], occlusion=bool(rng.random() < 0.6))
        way = path(asked, DETOUR)
        truth = true_margins(asked, way, 4001)
        lowest = min(m for m, _, _ in truth.values())
        margins = {name: m - 1e-5 if m > 2e-5 else 0.0 for name, (m, _, _) in truth.items()}
        answer = verify_plan(plan(asked, way, margins))
        if lowest < 0:
            assert answer.status == "refuted"
        elif lowest > 1e-5:
            assert answer.status == "certified", answer.reasons
            name = str(rng.choice([n for n in truth if "obstacle" in n]))
            margins[name] = truth[name][0] * (1 + 1e-9)
            assert verify_plan(plan(asked, way, margins)).status == "refuted"
        seen[answer.status] += 1
    assert seen["certified"] >= 3
    assert seen["refuted"] >= 1


def test_a_motion_that_carries_the_whole_scene_changes_nothing():
    # Path and obstacle move together: the same distances as those of the resting pair.
    drift = [[0.05, -0.02, 0.0], [0.0, 0.03, 0.0], [0.01, 0.0, 0.0]]
    ball = {"type": "sphere", "center": [0.0, -0.06, 0.08], "radius": 0.02}
    still = problem(obstacles=[ball], clearance=0.0)
    way = path(still, DETOUR)
    margin = true_margins(still, way)["clearance obstacle 0"][0]
    asked = copy.deepcopy(still)
    asked["obstacles"][0]["motion"] = drift
    carried = {**way, "translation": (np.array(way["translation"]) + drift).tolist()}
    asked["goal"]["translation"] = np.sum(carried["translation"], axis=1).tolist()
    truth = {name: m - slack(m) for name, (m, _, _) in true_margins(asked, carried).items()}
    for given, status in ((margin - 1e-9, "certified"), (margin + 1e-9, "refuted")):
        answer = verify_plan(plan(asked, carried, {**truth, "clearance obstacle 0": given}))
        assert answer.status == status, answer.reasons


@pytest.fixture(scope="module")
def separated():
    asked = problem(obstacles=[BOX, CAPSULE], clearance=0.01, occlusion=True)
    document = plan_path(PlanningProblem.from_dict(asked)).to_dict()
    assert document["status"] == "certified"
    return document


def test_bodies_at_rest_after_a_constant_motion_are_separated_by_the_same_planes(separated):
    document = copy.deepcopy(separated)
    box, capsule = document["problem"]["obstacles"]
    shift = np.array([0.5, -0.25, 0.125])
    box["center"] = (np.array(box["center"]) - shift).tolist()
    for end in ("from", "to"):
        capsule[end] = (np.array(capsule[end]) - shift).tolist()
    assert verify_plan(document).status == "refuted"
    for body in (box, capsule):
        body["motion"] = [[0.0, x] for x in shift]
    answer = verify_plan(document)
    assert answer.status == "certified", answer.reasons


@pytest.mark.parametrize("index", [0, 1])
def test_a_body_that_moves_into_the_path_or_a_line_of_sight_is_refuted(separated, index):
    document = copy.deepcopy(separated)
    body = document["problem"]["obstacles"][index]
    body["motion"] = [[0.0, 0.0, 0.0]] * 3
    assert verify_plan(document).status == "certified"
    # At rest at both ends, on the path half way.
    center = np.array(body["center"] if index == 0 else body["to"])
    across = 4 * (np.array([np.polyval(row, 0.5) for row in document["path"]["translation"]]) - center)
    body["motion"] = [[-x, x, 0.0] for x in across]
    answer = verify_plan(document)
    assert answer.status == "refuted"
    assert any(f"obstacle {index}" in reason for reason in answer.reasons)


def test_an_end_pose_is_infeasible_only_where_the_obstacle_is_at_that_end():
    def answer(at_start, at_goal):
        goal = np.array([0.0, -0.1, 0.2])
        begin = np.where(at_start, 0.0, 5.0) * np.ones(3)
        end = goal if at_goal else np.full(3, 7.0)
        rows = np.column_stack([end - begin, begin]).tolist()
        asked = problem(
            goal={"translation": goal.tolist(), "quaternion": [0.0, 0.0, 0.0, 1.0]},
            obstacles=[{"type": "sphere", "center": [0.0, 0.0, 0.0], "radius": 0.05, "motion": rows}],
        )
        return verify_plan(plan(asked, None, {"rotation": 0.0, "x": 1.0}, status="infeasible")).reasons[0]

    assert "confirmed at the start" in answer(True, False)
    assert "confirmed at the goal" in answer(False, True)
    # It passes both poses half way, when the camera may be elsewhere.
    assert "both end poses satisfy" in answer(False, False)


@pytest.mark.parametrize(
    "motion",
    [
        [[0.0]] * 2,
        [[]] * 3,
        [[0.0], [0.0], [0.0, 1.0]],
        [[0.0] * 18] * 3,
        [[float("nan")]] * 3,
        [["1"]] * 3,
        7,
        [1.0, 2.0, 3.0],
    ],
)
def test_a_malformed_motion_is_refuted(motion):
    asked = problem()
    asked["obstacles"][0]["motion"] = motion
    reference = problem()
    way = path(reference, DETOUR)
    document = plan(asked, way, dict.fromkeys(true_margins(reference, way, 50), 0.0))
    answer = verify_plan(document)
    assert answer.status == "refuted"
    assert "problem.obstacles[0].motion" in answer.reasons[0]
