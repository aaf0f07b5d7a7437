"""Obstacles that move with w: kept off, seen past, and proven where they are at that w."""

import re

import numpy as np
import pytest
from scipy.optimize import minimize_scalar
from scipy.spatial.transform import RigidTransform, Rotation
from solids import (
    FINE,
    GOAL,
    POINTS,
    asked,
    detour,
    displaced,
    distances,
    margins_of,
    sight_distance,
    true_clearance,
)

from omniservo.errors import InputError
from omniservo.planning import Box, Capsule, HalfSpace, Plan, PlanningProblem, Sphere, certify, plan_path
from omniservo.replanning.frame_change import seen_from
from omniservo.verification import verify_plan

TURNED = Rotation.from_quat([0.1, 0.7, -0.1, 0.7]).as_quat()
ACROSS = np.array([[0.0, 0.5, -0.25], [0.1, -0.1, 0.025], [0.0, 0.04, -0.02]])
"""m(w) [m]: through the straight path from one side to the other, in its middle at w = ½."""

MOVING = {
    "sphere": Sphere([0.0, -0.05, 0.1], 0.03, motion=ACROSS),
    "point": Sphere([0.0, -0.05, 0.1], motion=ACROSS),
    "box": Box([0.0, -0.05, 0.1], [0.02, 0.03, 0.04], TURNED, motion=ACROSS),
    "capsule": Capsule([0.0, -0.1, 0.1], [0.02, 0.0, 0.08], 0.015, motion=ACROSS),
    "half-space": HalfSpace([0.0, 0.6, 0.8], -0.12, motion=[[0, 0, 0], [-0.6, 0.6, 0.0], [-0.4, 0.4, 0.0]]),
}


@pytest.mark.parametrize("name", MOVING)
def test_a_moving_obstacle_in_the_way_is_avoided_and_its_margin_is_true(name):
    obstacle = MOVING[name]
    assert true_clearance(obstacle, detour([0.0, 0.0, 0.0])) < 0.01
    problem = asked(obstacle, occlusion=True)
    plan = plan_path(problem)
    assert plan.status == "certified", plan.reason
    assert verify_plan(plan).status == "certified"
    found = margins_of(plan.certificate)
    seen = true_clearance(obstacle, plan.path) - problem.clearance
    assert 0.0 <= found["clearance obstacle 0"] <= seen < found["clearance obstacle 0"] + 1e-3
    if name in ("half-space", "point"):
        assert "occlusion obstacle 0" not in found
        return
    seen = min(
        sight_distance(obstacle, t - m, h - m)
        for t, m in zip(plan.path.positions(FINE[::25]), displaced(obstacle, FINE[::25]), strict=True)
        for h in POINTS
    )
    assert 0.0 <= found["occlusion obstacle 0"] <= seen < found["occlusion obstacle 0"] + 1e-3


def test_each_of_several_obstacles_moves_its_own_way():
    still, away = Box([0.3, 0.3, 0.1], [0.02] * 3, TURNED), np.array([[0.1, 0.0], [0.0, 0.0], [0.2, 0.0]])
    obstacles = (MOVING["sphere"], still, Capsule([0.3, 0.0, 0.0], [0.3, 0.0, 0.1], 0.02, motion=away))
    _, certificate = certify(asked(*obstacles), path := detour([0.0, 0.12, 0.12]))
    found = margins_of(certificate)
    for i, obstacle in enumerate(obstacles):
        assert found[f"clearance obstacle {i}"] == pytest.approx(
            true_clearance(obstacle, path) - 0.01, abs=1e-3
        )


@pytest.mark.parametrize("degree", [2, 8])
@pytest.mark.parametrize("name", MOVING)
def test_a_violation_between_samples_is_never_certified(name, degree):
    obstacle, path = MOVING[name], detour([0.0, 0.12, 0.12])
    if degree == 8:
        obstacle = type(obstacle)(
            **(vars(obstacle) | {"motion": np.column_stack([[-0.05] * 3, np.zeros((3, 5)), obstacle.motion])})
        )
    truth = true_clearance(obstacle, path)
    assert truth > 1e-3
    for beyond in (1e-3, 1e-6, 1e-9, 1e-10):
        problem = asked(obstacle, clearance=truth + beyond)
        verdict, certificate = certify(problem, path)
        assert verdict != "certified"
        plan = Plan(problem, "certified", path, certificate, 0.0, "certified")
        assert verify_plan(plan).status == "refuted"
        if verdict == "refuted":
            worst = certificate.worst
            t, m = path.positions(worst.w), displaced(obstacle, worst.w)
            assert distances(obstacle, t - m) < truth + beyond
    for below in (1e-3, 1e-6, 1e-8):
        assert certify(asked(obstacle, clearance=truth - below), path)[0] == "certified"


def test_a_point_hidden_for_a_moment_is_never_certified():
    """The rod passes between the camera and a target point, nearest between the samples."""
    path, h = detour([0.0, 0.0, 0.0]), np.array([[0.1, 0.1, 0.6]])
    rod = Capsule(
        [-0.1, 0.11, 0.35], [0.08, 0.12, 0.35], 0.005, motion=[[0, 0, 0], [0.28, -0.28, 0], [0, 0, 0]]
    )

    def seen(w):
        m = displaced(rod, w)
        return sight_distance(rod, path.positions(w) - m, h[0] - m)

    nearest = min(FINE[::25], key=seen)
    near = max(nearest - 0.01, 0.0), min(nearest + 0.01, 1.0)
    truth = minimize_scalar(seen, bounds=near, method="bounded", options={"xatol": 1e-10}).fun
    assert truth > 1e-3
    for grown, expected in ((truth + 1e-6, False), (truth - 1e-6, True)):
        thicker = Capsule(rod.start, rod.end, rod.radius + grown, motion=rod.motion)
        verdict, _ = certify(asked(thicker, points=h, clearance=0.0, occlusion=True), path)
        assert (verdict == "certified") == expected
    still = Capsule(rod.start, rod.end, rod.radius + truth + 1e-3)
    assert certify(asked(still, points=h, clearance=0.0, occlusion=True), path)[0] == "certified"


@pytest.mark.parametrize("name", ["box", "capsule", "half-space"])
def test_an_obstacle_displaced_for_good_is_the_obstacle_there(name):
    shift = np.array([0.01, 0.05, -0.03])
    there = {
        "box": Box(np.add([0.0, 0.1, 0.1], shift), [0.02, 0.03, 0.04], TURNED),
        "capsule": Capsule(np.add([0.0, 0.1, 0.1], shift), np.add([0.02, 0.2, 0.08], shift), 0.015),
        "half-space": HalfSpace([0.0, 0.6, 0.8], -0.15 + 0.6 * shift[1] + 0.8 * shift[2]),
    }[name]
    moved = {
        "box": Box([0.0, 0.1, 0.1], [0.02, 0.03, 0.04], TURNED, motion=shift[:, None]),
        "capsule": Capsule([0.0, 0.1, 0.1], [0.02, 0.2, 0.08], 0.015, motion=shift[:, None]),
        "half-space": HalfSpace([0.0, 0.6, 0.8], -0.15, motion=shift[:, None]),
    }[name]
    path = detour([0.02, 0.0, 0.0])
    lines = [margins_of(certify(asked(o, occlusion=True), path)[1]) for o in (there, moved)]
    assert lines[0].keys() == lines[1].keys()
    for line, margin in lines[0].items():
        assert abs(lines[1][line] - margin) < 1e-9, line


def test_end_poses_meet_the_obstacle_where_it_is_then():
    at_goal = np.array([[0.0, 0.0], [0.0, 0.0], [-0.5, 0.0]])
    plan = plan_path(asked(Sphere(np.add(GOAL, [0.0, 0.0, 0.5]), 0.02, motion=at_goal)))
    assert plan.status == "infeasible"
    assert re.search(r"goal pose \(w = 1\) violates clearance obstacle 0: falls short by 0.03 m", plan.reason)
    away = np.array([[0.0, 0.0], [0.0, 0.0], [0.5, 0.0]])
    assert plan_path(asked(Sphere(GOAL, 0.02, motion=away))).status == "certified"
    before_point = Sphere(POINTS[4] * 0.5, 0.01, motion=[[1.0, 0.0], [0.0, 0.0], [0.0, 0.0]])
    plan = plan_path(asked(before_point, occlusion=True))
    assert re.search(r"start .* occlusion obstacle 0 \(point 4\): falls short by 0.01", plan.reason)


def test_planes_are_stored_for_bodies_that_move_and_not_for_spheres():
    problem = asked(
        MOVING["sphere"], MOVING["box"], Sphere([0.3, 0, 0], 0.01), points=POINTS[:1], occlusion=True
    )
    plan = plan_path(problem)
    assert plan.status == "certified", plan.reason
    found = {(s.constraint, s.point) for s in plan.certificate.separators}
    assert found == {("clearance obstacle 1", None), ("occlusion obstacle 1", 0)}
    corners = np.array([[a, b, c] for a in (-1, 1) for b in (-1, 1) for c in (-1, 1)])
    box = problem.obstacles[1]
    corners = corners * box.half_extents @ Rotation.from_quat(box.quaternion).as_matrix().T + box.center
    for separator in plan.certificate.separators:
        for start, end, *normal in separator.pieces:
            w = np.linspace(start, end, 20)
            reach = (corners @ normal).max() + (problem.clearance if separator.point is None else 0.0)
            ends = [plan.path.positions(w)] + ([] if separator.point is None else [POINTS[:1]])
            for x in ends:
                assert ((x - displaced(box, w)) @ normal).min() >= reach


@pytest.mark.parametrize("name", MOVING)
def test_from_a_pose_on_the_way_the_rest_of_a_motion_is_seen(name):
    rng = np.random.default_rng(5)
    pose = RigidTransform.from_components([0.1, -0.2, 0.05], Rotation.from_rotvec([0.3, 0.1, -0.2]))
    seen = seen_from(MOVING[name], pose.inv(), 0.4)
    for s in (0.0, 0.3, 1.0):
        x = rng.normal(size=(20, 3))
        before = distances(MOVING[name], x - displaced(MOVING[name], 0.4 + 0.6 * s))
        after = distances(seen, pose.inv().apply(x) - displaced(seen, s))
        assert np.allclose(before, after, rtol=0.0, atol=1e-12)


def test_motions_survive_the_file():
    problem = asked(*MOVING.values())
    again = PlanningProblem.from_dict(problem.to_dict())
    assert again.to_dict() == problem.to_dict()
    for a, b in zip(again.obstacles, problem.obstacles, strict=True):
        assert np.array_equal(a.motion, b.motion)
    assert "motion" not in asked(Sphere([0, 0, 1])).to_dict()["obstacles"][0]


BAD = {
    "two axes": ([[0.1], [0.2]], r"motion: shape \(2, 1\) given; \(3, any\) is needed"),
    "ragged": ([[0.1], [0.2], [0.1, 0.2]], "motion: "),
    "empty": ([[], [], []], "motion: 0 coefficients an axis given; legal: 1 to 17"),
    "degree 17": (np.zeros((3, 18)).tolist(), "motion: 18 coefficients an axis given; legal: 1 to 17"),
    "NaN": ([[0.1], [float("nan")], [0.1]], r"motion: nan at index \(1, 0\)"),
    "far": ([[1e7], [0.0], [0.0]], r"motion: 1e\+07 given; legal: -1e6 to 1e6"),
    "text": ("fast", "motion: "),
}


@pytest.mark.parametrize("name", BAD)
def test_a_wrong_motion_is_named(name):
    motion, says = BAD[name]
    fields = asked(Sphere([0, 0, 1])).to_dict()
    fields["obstacles"][0]["motion"] = motion
    with pytest.raises(InputError, match=r"obstacles\[0\]\." + says):
        PlanningProblem.from_dict(fields)


def test_the_papers_method_refuses_what_moves_by_name():
    with pytest.raises(InputError, match='method: "paper" given; legal: "certified", where obstacle 1 moves'):
        plan_path(asked(Sphere([0.1, 0, 0]), MOVING["sphere"]), method="paper")
