"""The tracker on plans that the planner made."""

import numpy as np
import pytest
from kinematic_loop import FISHEYE, FRONT, Loop
from scipy.spatial.transform import Rotation

from omniservo.errors import InputError
from omniservo.planning import CameraPath, Plan, PlanningProblem, plan_path
from omniservo.tracking import PathTracker, TrackerOptions
from omniservo.tracking.path_state import path_state

PROBLEM = {
    "format": "omniservo.problem/1",
    "camera": FISHEYE.to_dict(),
    "points": FRONT.tolist(),
    "goal": {
        "translation": [4.97e-5, -0.0999782, 0.1999552],
        "quaternion": Rotation.from_rotvec(np.radians([-0.003, 0.0013, -0.0015])).as_quat().tolist(),
    },
    "obstacles": [
        {"type": "sphere", "center": [-0.01, -0.065, 0.085], "radius": 0.0},
        {"type": "sphere", "center": [-0.005, -0.08, 0.09], "radius": 0.0},
    ],
    "clearance": 0.061,
    "least_distance": 0.02,
}
"""The paper's example 1 with a tracking margin of 6 mm."""


@pytest.fixture(scope="module")
def plan():
    made = plan_path(PlanningProblem.from_dict(PROBLEM))
    assert made.status == "certified"
    return made


@pytest.mark.parametrize("degrees", [(1, 1), (2, 2), (4, 3)])
def test_compiled_path_agrees_with_the_camera_path(degrees):
    rng = np.random.default_rng(6)
    rotation = 0.3 * rng.standard_normal((4, degrees[0] + 1))
    rotation[3, -1] += 2.0
    path = CameraPath(rotation, rng.standard_normal((3, degrees[1] + 1)))
    for w in np.linspace(0.0, 1.0, 7):
        pose, twist = np.empty(7), np.empty(6)
        path_state(rotation, path.translation.copy(), w, pose, twist)
        expected = path(w)
        np.testing.assert_allclose(pose[4:], expected.translation, atol=1e-14)
        assert (Rotation.from_quat(pose[:4]).inv() * expected.rotation).magnitude() < 1e-14
        np.testing.assert_allclose(twist, path(w, 1), atol=1e-12)


def test_certified_plan_is_followed_round_the_obstacle(plan):
    loop = Loop(FISHEYE, noise=0.03)
    tracker = PathTracker(plan, FISHEYE, options=TrackerOptions(delay=0.005))
    obstacles = np.array([o["center"] for o in PROBLEM["obstacles"]])
    loop.run(tracker, plan.path, 8.0)
    assert tracker.done
    gaps = np.array(loop.positions)[:, None] - obstacles
    assert np.linalg.norm(gaps, axis=2).min() > 0.055
    assert max(loop.deviations) < 2e-3
    goal = plan.problem.initial_T_goal
    assert np.linalg.norm(loop.pose.translation - goal.translation) < 3e-4


def test_on_a_certified_plan_the_twist_is_the_planned_twist(plan):
    for time in (0.7, 2.0, 3.1):
        tracker = PathTracker(plan, FISHEYE)
        w, w_dot = tracker.time_law(time)
        twist = tracker.step(time, Loop(FISHEYE, pose=plan.path(w)).look())
        np.testing.assert_allclose(twist, w_dot * plan.path(w, 1), atol=1e-12)


def test_a_saved_plan_gives_the_same_twist(plan, tmp_path):
    plan.save(tmp_path / "plan.json")
    loaded = Plan.load(tmp_path / "plan.json")
    pixels = Loop(FISHEYE, pose=plan.path(0.4)).look()
    np.testing.assert_array_equal(
        PathTracker(plan, FISHEYE).step(1.8, pixels),
        PathTracker(loaded, loaded.problem.camera).step(1.8, pixels),
    )


def test_an_infeasible_plan_cannot_be_followed():
    blocked = plan_path(PlanningProblem.from_dict({**PROBLEM, "clearance": 0.3}))
    assert blocked.path is None
    with pytest.raises(InputError, match="plan: status 'infeasible' without a path"):
        PathTracker(blocked, FISHEYE)
