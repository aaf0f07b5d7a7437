"""Boxes, capsules and half-spaces: kept off, seen past, and proven."""

import json
import re

import numpy as np
import pytest
from scipy.optimize import minimize_scalar
from scipy.spatial.transform import Rotation
from solids import FINE, POINTS, asked, detour, distances, margins_of, sight_distance, true_clearance

from omniservo.errors import InputError
from omniservo.planning import (
    Box,
    Capsule,
    HalfSpace,
    Plan,
    PlanningProblem,
    certify,
    plan_path,
)
from omniservo.planning.constraints.body_gap import segment_gap
from omniservo.planning.end_poses import violation_at_end
from omniservo.planning.problem_arrays import constraints_of, image_limits
from omniservo.verification import verify_plan

TILTED = [0.1, 0.7, -0.1, 0.7]

BODIES = {
    "box": Box([0.01, -0.05, 0.1], [0.05, 0.012, 0.02], Rotation.from_quat(TILTED).as_quat()),
    "capsule": Capsule([-0.1, -0.055, 0.1], [0.08, -0.045, 0.11], 0.015),
    "half-space": HalfSpace([0.0, 0.6, 0.8], -0.075),
}


@pytest.mark.parametrize("occlusion", [False, True])
@pytest.mark.parametrize("name", BODIES)
def test_the_margin_is_below_dense_sampling_and_within_a_millimetre(name, occlusion):
    obstacle = BODIES[name]
    problem = asked(obstacle, occlusion=occlusion)
    plan = plan_path(problem)
    assert plan.status == "certified", plan.reason
    found = margins_of(plan.certificate)
    seen = true_clearance(obstacle, plan.path) - problem.clearance
    assert 0.0 <= found["clearance obstacle 0"] <= seen < found["clearance obstacle 0"] + 1e-3
    assert verify_plan(plan).status == "certified"
    if occlusion and name != "half-space":
        t = plan.path.positions(FINE[::25])
        seen = min(sight_distance(obstacle, a, h) for a in t for h in POINTS)
        assert 0.0 <= found["occlusion obstacle 0"] <= seen < found["occlusion obstacle 0"] + 1e-3
    else:
        assert "occlusion obstacle 0" not in found


@pytest.mark.parametrize("name", BODIES)
def test_a_violation_between_samples_is_never_certified(name):
    path = detour([0.0, 0.12, 0.0] if name != "half-space" else [0.0, -0.01, -0.01])
    obstacle = BODIES[name]
    truth = true_clearance(obstacle, path)
    assert truth > 1e-3
    for beyond in (1e-3, 1e-6, 1e-9, 1e-10):
        problem = asked(obstacle, clearance=truth + beyond)
        verdict, certificate = certify(problem, path)
        assert verdict != "certified"
        plan = Plan(problem, "certified", path, certificate, 0.0, "certified")
        assert verify_plan(plan).status == "refuted"
    for below in (1e-3, 1e-6, 1e-8):
        verdict, certificate = certify(asked(obstacle, clearance=truth - below), path)
        assert verdict == "certified"


def test_a_point_hidden_between_samples_is_never_certified():
    path, rod = detour([0.0, 0.07, -0.02]), BODIES["capsule"]
    h = np.array([[0.0, 0.15, 0.5]])

    def seen(w):
        return sight_distance(rod, path.positions(w), h[0])

    nearest = min(FINE[::25], key=seen)
    near = max(nearest - 0.01, 0.0), min(nearest + 0.01, 1.0)
    truth = minimize_scalar(seen, bounds=near, method="bounded", options={"xatol": 1e-10}).fun
    assert truth > 1e-3
    for grown, expected in ((truth + 1e-6, False), (truth - 1e-6, True)):
        thicker = Capsule(rod.start, rod.end, rod.radius + grown)
        verdict, _ = certify(asked(thicker, points=h, clearance=0.0, occlusion=True), path)
        assert (verdict == "certified") == expected


def test_gap_is_the_distance_and_its_direction_the_gradient():
    rng = np.random.default_rng(4)
    touching = 0
    for k in range(150):
        center, turn, extents = rng.normal(size=3) * 0.3, Rotation.random(rng=rng), rng.uniform(0.05, 0.5, 3)
        if k % 3 == 0:
            body = Capsule(center, center + rng.normal(size=3), 0.1, 0.0)
        else:
            body = Box(center, extents, turn.as_quat(), 0.0)
        row = constraints_of(asked(body), image_limits(asked(), 0.0)).bodies[0]
        t, h = rng.normal(size=(2, 3)) * 0.5
        *normal, gap, part = segment_gap(row, *t, *h)
        assert abs(np.linalg.norm(normal) - 1.0) < 1e-12
        if gap <= 1e-6:
            touching += 1
            assert sight_distance(body, t, h) + row[15] < 1e-6
            free = -1.000001 * gap * np.array(normal)
            freed = segment_gap(row, *(t + free), *(h + free))
            assert abs(freed[3]) < 1e-5
            continue
        assert abs(sight_distance(body, t, h) + row[15] - gap) < 1e-7
        for axis in range(3):
            step = 1e-6 * np.eye(3)[axis]
            slope = (segment_gap(row, *(t + step), *h)[3] - segment_gap(row, *(t - step), *h)[3]) / 2e-6
            assert abs(slope - (1.0 - part) * normal[axis]) < 1e-4
    assert 10 < touching < 140


def test_a_segment_of_no_length_is_a_point():
    problem = asked(BODIES["box"])
    row = constraints_of(problem, image_limits(problem, 0.0)).bodies[0]
    for x in np.random.default_rng(2).normal(size=(100, 3)) * 0.1 + BODIES["box"].center:
        assert abs(segment_gap(row, *x, *x)[3] - distances(BODIES["box"], x)) < 1e-12


END_POSES = {
    "box at the start": (
        Box([0, 0, 0.03], [0.01, 0.01, 0.025], [0, 0, 0, 1]),
        r"start pose \(w = 0\) violates clearance obstacle 0: falls short by 0.005 m",
    ),
    "inside a box": (Box([0, 0, 0], [0.01, 0.02, 0.03], [0, 0, 0, 1]), r"obstacle 0: falls short by 0.02 m"),
    "capsule at the goal": (
        Capsule([-0.1, -0.085, 0.2], [0.1, -0.085, 0.2], 0.01),
        r"goal pose \(w = 1\) violates clearance obstacle 0: falls short by 0.005 m",
    ),
    "half-space": (HalfSpace([0, 1, 0], -0.105), r"goal .* clearance obstacle 0: falls short by 0.005 m"),
    "box before a point": (
        Box(POINTS[4] * 0.5, [0.02, 0.02, 0.001], [0, 0, 0, 1]),
        r"start .* occlusion obstacle 0 \(point 4\)",
    ),
    "capsule before a point": (
        Capsule(POINTS[4] * 0.5, POINTS[4] * 0.5 + [0.05, 0.0, 0.0], 0.01),
        r"start .* occlusion obstacle 0 \(point 4\): falls short by 0.01",
    ),
}


@pytest.mark.parametrize("name", END_POSES)
def test_an_end_pose_that_violates_is_named_and_confirmed(name):
    obstacle, says = END_POSES[name]
    plan = plan_path(asked(obstacle, occlusion=True))
    assert plan.status == "infeasible"
    assert re.search(says, plan.reason), plan.reason
    assert verify_plan(plan).reasons[0].startswith("infeasible confirmed")


def test_target_points_on_a_wall_are_seen_although_the_wall_is_an_obstacle():
    wall = HalfSpace([0.0, 0.0, -1.0], -0.6)
    points = np.array([[-0.1, 0.0, 0.6], [0.1, 0.0, 0.6], [0.0, 0.1, 0.6]])
    plan = plan_path(asked(wall, points=points, occlusion=True))
    assert plan.status == "certified"
    assert verify_plan(plan).status == "certified"


def test_plans_read_back_as_they_were_saved(tmp_path):
    plan = plan_path(asked(*BODIES.values(), occlusion=True))
    assert plan.status == "certified", plan.reason
    plan.save(tmp_path / "plan.json")
    again = Plan.load(tmp_path / "plan.json")
    assert json.dumps(again.to_dict()) == json.dumps(plan.to_dict())
    assert verify_plan(tmp_path / "plan.json").status == "certified"
    separators = again.certificate.separators
    assert {(s.constraint, s.point) for s in separators} == {
        *((f"clearance obstacle {i}", None) for i in (0, 1)),
        *((f"occlusion obstacle {i}", j) for i in (0, 1) for j in range(5)),
    }
    for separator in separators:
        assert separator.pieces[0, 0] == 0.0
        assert separator.pieces[-1, 1] == 1.0
        assert np.array_equal(separator.pieces[1:, 0], separator.pieces[:-1, 1])


def box(**changes):
    return {
        "type": "box",
        "center": [0, 0, 1],
        "quaternion": [0, 0, 0, 1],
        "half_extents": [1, 1, 1],
    } | changes


def capsule(**changes):
    return {"type": "capsule", "from": [0, 0, 1], "to": [0, 1, 1], "radius": 0.1} | changes


def half_space(**changes):
    return {"type": "half_space", "normal": [0, 0, -1], "offset": -1.0} | changes


BAD = {
    "flat box": (box(half_extents=[1, 0, 1]), r"half_extents: \[1.0, 0.0, 1.0\] given; legal: > 0"),
    "box inside out": (box(half_extents=[1, -1, 1]), "half_extents"),
    "box not unit": (box(quaternion=[0, 0, 0, 1.1]), "quaternion: length 1.1 given; legal: 1 within 1e-06"),
    "box NaN": (box(center=[0, float("nan"), 0]), "center: nan at index"),
    "box far": (box(center=[0, 1e7, 0]), r"center: 1e\+07 given"),
    "box radius": (
        box(radius=1),
        "radius: no such field; legal: type, center, half_extents, quaternion",
    ),
    "box without size": (
        {"type": "box", "center": [0, 0, 1]},
        "missing; needed: type, center",
    ),
    "thin capsule": (capsule(radius=0), "radius: 0 given; legal: > 0"),
    "capsule text": (capsule(radius="big"), "radius: 'big' given"),
    "capsule one end": ({"type": "capsule", "from": [0, 0, 1], "radius": 1}, "to: missing"),
    "capsule start": (capsule(**{"from": [0, 1]}), r"from: shape \(2,\) given"),
    "normal long": (half_space(normal=[0, 0, 2]), "normal: length 2 given; legal: 1 within 1e-06"),
    "normal zero": (half_space(normal=[0, 0, 0]), "normal: length 0 given"),
    "offset": (half_space(offset=float("inf")), "offset: inf given"),
    "own clearance": (half_space(clearance=-1), "clearance: -1 given; legal: >= 0"),
    "unknown": ({"type": "torus"}, "type: 'torus' given; legal: 'sphere', 'box', 'capsule', 'cylinder'"),
    "type a list": ({"type": ["box"]}, r"type: \['box'\] given"),
}


@pytest.mark.parametrize("name", BAD)
def test_a_wrong_field_of_an_obstacle_is_named(name):
    obstacle, says = BAD[name]
    fields = asked().to_dict() | {"obstacles": [box(), obstacle]}
    with pytest.raises(InputError, match=r"obstacles\[1\]\." + says if "missing" not in says else says):
        PlanningProblem.from_dict(fields)


def test_nearly_unit_vectors_are_normalised_and_stay():
    fields = asked().to_dict()
    fields["obstacles"] = [box(quaternion=[0, 0, 6e-7, 1.0000005]), half_space(normal=[0, 0.6, -0.8000004])]
    problem = PlanningProblem.from_dict(fields)
    for vector in (problem.obstacles[0].quaternion, problem.obstacles[1].normal):
        assert abs(np.linalg.norm(vector) - 1.0) < 1e-15
    assert PlanningProblem.from_dict(problem.to_dict()).to_dict() == problem.to_dict()


def test_the_papers_method_refuses_what_the_paper_has_not():
    with pytest.raises(InputError, match='method: "paper" given'):
        plan_path(asked(BODIES["box"]), method="paper")


def cluttered(rng, occlusion):
    """A box for every tenth of a metre or so, none at the end poses."""
    while True:
        goal = rng.normal(size=3)
        goal *= rng.uniform(0.15, 0.35) / np.linalg.norm(goal)
        goal[2] = min(goal[2], 0.15)
        points = np.array([0.0, 0.0, 0.6]) + rng.uniform(-0.12, 0.12, (4, 3))
        obstacles = [
            Box(
                rng.uniform(0.2, 0.8) * goal + rng.normal(size=3) * 0.06,
                rng.uniform(0.005, 0.05, 3),
                Rotation.random(rng=rng).as_quat(),
            )
            for _ in range(rng.integers(2, 7))
        ]
        problem = asked(*obstacles, points=points, goal=goal, occlusion=occlusion)
        if not violation_at_end(problem):
            return problem


@pytest.mark.parametrize("occlusion", [False, True])
def test_cluttered_boxes_are_planned_and_never_touched(occlusion):
    rng = np.random.default_rng([2012, occlusion])
    certified = straight = 0
    for _ in range(50):
        problem = cluttered(rng, occlusion)
        plan = plan_path(problem)
        if plan.status != "certified":
            continue
        certified += 1
        straight += plan.path.degrees[1] == 1
        t, found = plan.path.positions(FINE), margins_of(plan.certificate)
        for i, obstacle in enumerate(problem.obstacles):
            seen = float(distances(obstacle, t).min()) - problem.clearance
            assert found[f"clearance obstacle {i}"] <= seen < found[f"clearance obstacle {i}"] + 1e-3
    assert certified >= 49
    assert straight < 40
