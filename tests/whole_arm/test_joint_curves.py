"""Camera paths that curves in joint space suggest, and turning to the goal by the long way round."""

import numpy as np
import pytest
from scipy.spatial.transform import RigidTransform, Rotation
from tests.whole_arm.arm_scenes import random_task

from omniservo.cameras import preset
from omniservo.errors import InputError
from omniservo.planning import CameraPath, PlanningProblem
from omniservo.planning.certificate.certify import certify
from omniservo.replanning import replan
from omniservo.replanning.replan_with_arm import replan_with_arm
from omniservo.robots import load_arm
from omniservo.verification import verify_plan
from omniservo.whole_arm import plan_with_arm
from omniservo.whole_arm.joint_curves import BENT, joint_curves

PLACES = 17


@pytest.fixture(scope="module", params=[("panda", 12), ("panda", 208), ("rx60", 103)])
def long_way(request):
    """A task whose camera has to turn the long way round, for the joints' ranges; and its plan."""
    arm, seed = request.param
    problem, setting = random_task(load_arm(arm), np.random.default_rng([2026, seed]))
    return problem, setting, plan_with_arm(problem, setting)


@pytest.fixture(scope="module", params=["panda", "rx60", "ur5e"])
def curves(request):
    """Curves of an arm to two postures at once: where it stands, all of degree 3."""
    arm, random = load_arm(request.param), np.random.default_rng(3)
    problem, setting = random_task(arm, random, degree=3)
    postures = arm.inverse(setting.base_T_flange(problem.initial_T_goal))[:2]
    return (
        problem,
        setting,
        postures,
        list(joint_curves(problem, setting, setting.start, postures, PLACES, 0)),
    )


def test_curves_begin_where_the_arm_stands_and_end_in_every_posture(curves):
    problem, setting, postures, found = curves
    assert len(found) == (1 + BENT) * len(postures)
    for k, (joints, path) in enumerate(found):
        np.testing.assert_allclose(joints[0], setting.start, atol=1e-15)
        np.testing.assert_allclose(joints[-1], postures[k % len(postures)], atol=1e-15)
        assert path.degrees == (3, 3)
        np.testing.assert_allclose(path(0.0).as_matrix(), np.eye(4), atol=1e-12)
        np.testing.assert_allclose(path(1.0).as_matrix(), problem.initial_T_goal.as_matrix(), atol=1e-12)


def test_the_first_curves_are_straight_and_the_others_each_bent_in_its_own_way(curves):
    _, _, postures, found = curves
    aside = [joints[PLACES // 2] - 0.5 * (joints[0] + joints[-1]) for joints, _ in found]
    np.testing.assert_allclose(aside[: len(postures)], 0.0, atol=1e-15)
    bent = np.array(aside[len(postures) :])
    apart = np.linalg.norm(bent[:, None] - bent, axis=2)[np.triu_indices(len(bent), 1)]
    assert apart.min() > 0.1


def test_a_path_is_the_polynomial_nearest_to_the_postures_with_these_ends(curves):
    _, setting, _, found = curves
    here, w = setting.base_T_initial.inv(), np.linspace(0.0, 1.0, PLACES)
    for joints, path in found:
        places = np.array(
            [(here * setting.arm.base_T_flange(q) * setting.flange_T_camera).translation for q in joints]
        )
        lacks = places - path.positions(w)
        # What is left is orthogonal to every way to move the two inner control points.
        for basis in (3 * w * (1 - w) ** 2, 3 * w**2 * (1 - w)):
            np.testing.assert_allclose(basis @ lacks, 0.0, atol=1e-9)


def test_the_arm_gets_there_where_the_camera_turns_the_long_way_round(long_way):
    problem, setting, found = long_way
    assert found.certified
    assert found.attempts > 16
    assert (found.plan.aim is None) == (setting.arm.dof == 6)  # seven joints are led along the curve
    end = found.plan.path.rotation.sum(axis=1)
    np.testing.assert_allclose(end / np.linalg.norm(end), -problem.goal_quaternion, atol=1e-9)
    assert verify_plan(found.plan.to_dict()).status == "certified"
    last = (
        setting.base_T_initial.inv() * setting.arm.base_T_flange(found.branch(1.0)) * setting.flange_T_camera
    )
    np.testing.assert_allclose(last.as_matrix(), problem.initial_T_goal.as_matrix(), atol=1e-7)


def test_the_long_way_is_all_the_way_round(long_way):
    problem, _, found = long_way
    w = np.linspace(0.0, 1.0, 2001)
    turned = np.trapezoid(np.linalg.norm(found.plan.path(w, 1)[:, 3:], axis=1), w)
    short = problem.initial_T_goal.rotation.magnitude()
    assert np.pi > short
    assert turned > 2.0 * np.pi - short - 1e-4


def test_replanning_goes_on_by_the_same_way_round(long_way):
    problem, setting, found = long_way
    path, w = found.plan.path, 0.4
    near = replan(found.plan, w)
    assert near.status == "certified"
    np.testing.assert_allclose(near.path(0.5).as_matrix(), (path(w).inv() * path(0.7)).as_matrix(), atol=1e-9)
    again = replan_with_arm(found.plan, found.branch, w, problem, setting)
    assert again.certified
    assert again.attempts == 1
    np.testing.assert_allclose(again.branch(1.0), found.branch(1.0), atol=0.2)


def test_a_path_may_end_at_the_goal_with_either_sign_and_nowhere_else():
    goal = RigidTransform.from_components([0.1, 0.0, 0.0], Rotation.from_rotvec([0.0, 0.0, 1.0]))
    problem = PlanningProblem(preset("fe185"), [[0.0, 0.05, 0.6], [0.1, 0.0, 0.7]], goal)
    straight, identity = np.array([[0.1, 0.0], [0.0, 0.0], [0.0, 0.0]]), np.array([0.0, 0.0, 0.0, 1.0])
    for sign in (1.0, -1.0):
        end = sign * problem.goal_quaternion
        path = CameraPath(np.stack([end - identity, identity], axis=1), straight)
        assert certify(problem, path)[0] == "certified"
        assert path(0.5).rotation.as_rotvec()[2] == pytest.approx(0.5 if sign > 0 else 0.5 - np.pi)
    off = problem.goal_quaternion * [1.0, 1.0, 0.99, 1.0]
    with pytest.raises(InputError, match="its end misses the goal"):
        certify(problem, CameraPath(np.stack([off - identity, identity], axis=1), straight))
