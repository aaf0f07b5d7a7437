"""Replanning on the way: the joint, the change of frame, what is kept of the old path."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import RigidTransform, Rotation

from omniservo.errors import InputError
from omniservo.planning import (
    Box,
    CameraPath,
    Capsule,
    Cylinder,
    Degrees,
    Ellipsoid,
    HalfSpace,
    Plan,
    Sphere,
    Workspace,
    certify,
    plan_path,
)
from omniservo.planning.end_poses import margins_at_ends
from omniservo.replanning import replan
from omniservo.replanning.frame_change import problem_from, seen_workspace, shifted_motion
from omniservo.replanning.rest_of_path import rest_controls
from omniservo.verification import verify_plan

FINE = np.linspace(0.0, 1.0, 2001)


def moved(problem, rng, size):
    """The first obstacle moved by ``size`` [m] in a random direction."""
    step = rng.normal(size=3)
    first = problem.obstacles[0]
    other = replace(first, center=first.center + size * step / np.linalg.norm(step))
    return replace(problem, obstacles=(other, *problem.obstacles[1:]))


@pytest.mark.parametrize("kind", ["fisheye", "pinhole", "catadioptric", "occlusion"])
def test_pose_and_velocity_go_on_at_the_joint(random_problems, look, kind):
    rng = np.random.default_rng(7)
    certified = 0
    for problem in random_problems(kind, 10):
        plan = plan_path(problem)
        w = rng.uniform(0.05, 0.9)
        new = replan(plan, w, moved(plan.problem, rng, rng.uniform(0.01, 0.03)))
        if new.path is None:
            assert "pose (w = " in new.reason
            continue
        here, there = plan.path(w), new.path(0.0)
        assert np.allclose(there.as_matrix(), np.eye(4), rtol=0.0, atol=1e-9)
        assert np.allclose(new.path(0.0, 1), (1.0 - w) * plan.path(w, 1), rtol=0.0, atol=1e-9)
        end = here * new.path(1.0)
        assert np.allclose(end.as_matrix(), problem.initial_T_goal.as_matrix(), rtol=0.0, atol=1e-8)
        if new.status == "certified":
            certified += 1
            assert min(look(new.problem, new.path, FINE).values()) >= 0.0
    assert certified >= 7


@pytest.mark.parametrize("w", [0.0, 0.2, 0.73])
def test_where_nothing_changed_the_rest_of_the_path_stays(random_problems, w):
    for problem in random_problems("fisheye", 8):
        plan = plan_path(problem)
        new = replan(plan, w)
        assert new.status == "certified"
        s = np.linspace(0.0, 1.0, 11)
        again = plan.path(w) * new.path(s)
        assert np.allclose(again.as_matrix(), plan.path(w + (1.0 - w) * s).as_matrix(), rtol=0.0, atol=1e-9)


def test_a_replan_can_be_replanned_and_is_verified(random_problems):
    rng = np.random.default_rng(3)
    for problem in random_problems("fisheye", 5):
        plan = plan_path(problem)
        for _ in range(3):
            new = replan(plan, 0.25, moved(plan.problem, rng, 0.005))
            if new.status != "certified":
                break
            assert new.problem.degrees == Degrees(3, 3)
            assert certify(new.problem, new.path)[0] == "certified"
            assert verify_plan(new).status == "certified"
            assert np.allclose(new.path(0.0, 1), 0.75 * plan.path(0.25, 1), rtol=0.0, atol=1e-9)
            plan = new
        assert plan.status == "certified"


def test_a_camera_at_rest_may_leave_in_any_direction(paper):
    plan = plan_path(paper(1))
    changed = moved(plan.problem, np.random.default_rng(0), 0.01)
    new = replan(plan, 0.0, changed)
    assert new.status == "certified"
    assert new.problem.initial_velocity is None
    assert new.problem.to_dict() == changed.to_dict()
    assert verify_plan(new).status == "certified"


def test_a_moved_goal_and_a_pose_and_velocity_of_ones_own(random_problems, look):
    rng = np.random.default_rng(11)
    certified = 0
    for problem in random_problems("fisheye", 10):
        plan = plan_path(problem)
        goal = problem.initial_T_goal
        other = RigidTransform.from_components(goal.translation + 0.006 * rng.normal(size=3), goal.rotation)
        w = 0.4
        error = RigidTransform.from_exp_coords(0.002 * rng.normal(size=6))
        pose, twist = plan.path(w) * error, plan.path(w, 1) + 0.01 * rng.normal(size=6)
        new = replan(plan, w, replace(problem, initial_T_goal=other), pose=pose, velocity=twist)
        if new.status != "certified":
            assert new.status == "infeasible"
            continue
        certified += 1
        assert np.allclose(new.path(0.0, 1), 0.6 * twist, rtol=0.0, atol=1e-9)
        assert np.allclose((pose * new.path(1.0)).as_matrix(), other.as_matrix(), rtol=0.0, atol=1e-8)
        assert min(look(new.problem, new.path, FINE).values()) >= 0.0
    assert certified >= 6


def test_what_blocks_the_rest_is_gone_round_by_a_search(paper):
    """A second goal behind the camera: nothing of the old path is of use."""
    plan = plan_path(paper(1, degrees=Degrees(4, 4)))
    back = RigidTransform.from_components([0.0, 0.05, -0.1], Rotation.identity())
    new = replan(plan, 0.5, replace(plan.problem, initial_T_goal=back))
    assert new.status == "certified"
    assert np.allclose(new.path(0.0, 1), 0.5 * plan.path(0.5, 1), rtol=0.0, atol=1e-9)


def everything(paper):
    """A problem with every kind of obstacle and workspace."""
    obstacles = (
        Sphere([-0.3, 0.1, 0.1], 0.02, 0.01),
        Box([0.4, 0.1, 0.2], [0.05, 0.1, 0.02], Rotation.from_rotvec([0.3, 0.2, 0.1]).as_quat()),
        Capsule([-0.3, -0.2, 0.0], [-0.2, -0.3, 0.3], 0.02),
        HalfSpace(np.array([0.6, 0.0, 0.8]), -0.5),
        Cylinder([0.3, -0.2, 0.0], [0.2, -0.3, 0.3], 0.02),
        Ellipsoid([-0.4, 0.3, 0.2], [0.05, 0.1, 0.02], Rotation.from_rotvec([0.3, 0.2, 0.1]).as_quat()),
    )
    workspace = Workspace([-0.5, -0.6, -0.5], [0.5, 0.6, 0.5], (HalfSpace([0.0, 0.0, 1.0], -0.3),))
    return replace(paper(1), obstacles=obstacles, workspace=workspace, occlusion=True, clearance=0.02)


def test_margins_are_the_same_seen_from_anywhere(paper):
    """Every margin at the goal, and at the pose from which is looked, against the old frame's."""
    problem = everything(paper)
    pose = RigidTransform.from_components([0.02, -0.05, 0.08], Rotation.from_rotvec([0.1, -0.2, 0.3]))
    rest = problem_from(problem, pose, 0.5, None)
    assert rest.workspace.min is None
    entries, (at_pose, at_goal) = margins_at_ends(rest)
    old, (_, old_at_goal) = margins_at_ends(problem)
    _, (_, old_at_pose) = margins_at_ends(replace(problem, initial_T_goal=pose))
    assert len(entries) == len(old)
    for found, expected in ((at_pose, old_at_pose), (at_goal, old_at_goal)):
        assert np.allclose(sorted(found[:, 0]), sorted(expected[:, 0]), rtol=0.0, atol=1e-9)
        for entry, margin in zip(entries, found, strict=True):
            same = [row for e, row in zip(old, expected, strict=True) if e.name == entry.name]
            assert entry.name.startswith("workspace") or np.allclose(margin, same[0], rtol=0.0, atol=1e-9)


def test_a_path_keeps_the_same_seen_from_anywhere(paper):
    """The same motion in both frames has the same certificate, walls included."""
    problem = everything(paper)
    plan = plan_path(problem)
    assert plan.status == "certified"
    new = replan(plan, 0.3)
    assert new.status == "certified"
    old = [c for c in plan.certificate.constraints if not c.name.startswith(("workspace", "rotation"))]
    for before, after in zip(old, new.certificate.constraints, strict=False):
        assert after.name.split(" (")[0] == before.name.split(" (")[0]
        if before.w > 0.31:
            assert after.margin == pytest.approx(before.margin, abs=3e-4 if before.unit == "m" else 0.05)
        else:
            assert after.margin >= before.margin - (3e-4 if before.unit == "m" else 0.05)


@pytest.mark.parametrize("degree", [1, 2, 3, 5])
def test_the_rest_of_a_polynomial_is_the_polynomial(degree):
    rng = np.random.default_rng(degree)
    coefficients = rng.normal(size=(3, degree + 1))
    for w in (0.0, 0.3, 0.99):
        for higher in (0, 1, 3):
            controls = rest_controls(coefficients, w, degree + higher)
            s = np.linspace(0.0, 1.0, 7)
            n = degree + higher
            basis = np.array([[_bernstein(n, k, x) for k in range(n + 1)] for x in s])
            expected = np.array([np.polyval(row, w + (1.0 - w) * s) for row in coefficients])
            assert np.allclose(controls @ basis.T, expected, rtol=0.0, atol=1e-12)


def _bernstein(n, k, x):
    from math import comb

    return comb(n, k) * x**k * (1.0 - x) ** (n - k)


def test_a_motion_goes_on_from_where_it_is():
    rng = np.random.default_rng(2)
    motion, turn = rng.normal(size=(3, 4)), Rotation.from_rotvec([0.1, 0.2, 0.3])
    motion[1, 0] = 0.0
    again = shifted_motion(motion, turn, 0.4)
    for s in (0.0, 0.3, 1.0):
        then = np.array([np.polyval(row, 0.4 + 0.6 * s) for row in motion])
        assert np.allclose([np.polyval(row, s) for row in again], turn.apply(then), atol=1e-14)


@pytest.mark.parametrize("w", [0.0, 0.35])
def test_a_moving_obstacle_goes_on_from_where_it_is(paper, w):
    """A sphere, a box and a wall that move: the rest of the path keeps what it kept, and is verified."""
    rng = np.random.default_rng(4)
    motions = [0.05 * rng.normal(size=(3, k)) for k in (2, 4, 3)]
    obstacles = (
        Sphere([-0.03, -0.06, 0.09], 0.0, motion=0.2 * motions[0]),
        Box([0.4, 0.1, 0.2], [0.05, 0.1, 0.02], [0.1, 0.2, 0.3, np.sqrt(0.86)], motion=motions[1]),
        HalfSpace([0.6, 0.0, 0.8], -0.5, motion=motions[2]),
    )
    problem = replace(paper(1), obstacles=obstacles)
    plan = plan_path(problem)
    assert plan.status == "certified"
    new = replan(plan, w)
    assert new.status == "certified"
    assert verify_plan(new).status == "certified"
    here = plan.path(w).inv()
    for s in (0.0, 0.3, 1.0):
        then = w + (1.0 - w) * s
        assert np.allclose((plan.path(w) * new.path(s)).as_matrix(), plan.path(then).as_matrix(), atol=1e-9)
        for old, seen in zip(obstacles[:2], new.problem.obstacles[:2], strict=True):
            expected = here.apply(old.center + [np.polyval(row, then) for row in old.motion])
            assert np.allclose(
                seen.center + [np.polyval(row, s) for row in seen.motion], expected, rtol=0.0, atol=1e-12
            )


BAD = {
    "w: 1 given": {"w": 1.0},
    "w: -0.1 given": {"w": -0.1},
    "w: nan given": {"w": float("nan")},
    "velocity": {"velocity": [0.0] * 5},
    "pose": {"pose": np.eye(4)},
    "problem: dict given": {"problem": {}},
    "time_budget": {"time_budget": 0.0},
    "seed": {"seed": -1},
}


@pytest.mark.parametrize("message", BAD)
def test_what_does_not_fit_is_refused(paper, message):
    plan = plan_path(paper(1))
    with pytest.raises(InputError, match=message):
        replan(plan, **BAD[message])


def test_a_plan_without_a_path_cannot_be_continued(paper):
    plan = Plan(paper(1), "infeasible", None, None, 0.0, "certified")
    with pytest.raises(InputError, match="without a path"):
        replan(plan)


def test_a_path_that_turns_the_other_way_round_is_searched_anew(paper):
    """The old path's φ ends at −q of the new goal: it would turn by 2π − θ."""
    problem = replace(paper(1), obstacles=())
    turn = Rotation.from_rotvec([0.0, 0.0, np.radians(170.0)])
    far = CameraPath(
        np.column_stack([turn.as_quat() - [0, 0, 0, 1], [0, 0, 0, 1]]),
        np.column_stack([problem.goal_translation, np.zeros(3)]),
    )
    old = Plan(replace(problem, initial_T_goal=far(1.0)), "undecided", far, None, 0.0, "certified")
    ahead = Rotation.from_rotvec([0.0, 0.0, np.radians(-100.0)])
    goal = RigidTransform.from_components(problem.goal_translation, ahead)
    new = replan(old, 0.0, replace(problem, initial_T_goal=goal))
    assert new.status == "certified"


@pytest.mark.parametrize("shift", [[0.0, 0.0, 0.0], [0.2, -0.1, 0.3]], ids=["", "shifted"])
@pytest.mark.parametrize("turn", [[0.0, 0.0, 0.0], [0.3, -0.5, 1.0]], ids=["", "turned"])
def test_a_workspace_is_the_same_places_in_any_other_frame(shift, turn):
    def inside(workspace, places):
        walls = [(np.array(side.normal), side.offset) for side in workspace.half_spaces]
        kept = np.all([places @ normal >= offset for normal, offset in walls], axis=0)
        if workspace.min is not None:
            kept &= ((places >= workspace.min) & (places <= workspace.max)).all(axis=1)
        return kept

    workspace = Workspace([-0.5, -0.6, -0.5], [0.5, 0.4, 0.7], (HalfSpace([0.0, 0.6, 0.8], -0.3),))
    here = RigidTransform.from_components(shift, Rotation.from_rotvec(turn))
    places = np.random.default_rng(0).uniform(-0.8, 0.8, (2000, 3))
    wanted = inside(workspace, places)
    assert 0.2 < wanted.mean() < 0.8
    np.testing.assert_array_equal(inside(seen_workspace(workspace, here), here.apply(places)), wanted)
