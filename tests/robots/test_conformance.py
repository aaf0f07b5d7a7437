"""The same claims for every arm: kinematics, limits, inverse, the world around it, the simulated drives."""

import mujoco
import numpy as np
import pytest
from scipy.optimize import minimize
from scipy.spatial.transform import RigidTransform, Rotation

from omniservo.cameras import preset
from omniservo.errors import InputError, JointLimit
from omniservo.robots import Arm
from omniservo.robots.arm import LEAST_SINGULAR_VALUE, LENGTH_SCALE, SINGULAR_VALUE
from omniservo.scenes import Scene
from omniservo.simulation import SimulatedRobot, World

FLANGE_T_CAMERA = RigidTransform.from_components([0.03, -0.02, 0.09], Rotation.from_rotvec([0.3, -0.8, 1.1]))
WORLD_T_BASE = RigidTransform.from_components([1, 2, 3], Rotation.from_rotvec([0.1, -0.4, 0.7]))


def random_joints(arm, count, seed):
    low, high = arm.joint_range.T
    return np.random.default_rng(seed).uniform(low, high, (count, arm.dof))


def bent(arm):
    """Joints far from every singularity, with room to all limits: the best of 200."""
    drawn = random_joints(arm, 200, 7) * 0.5 + 0.5 * arm.joint_range.mean(axis=1)
    smallest = [np.linalg.svd(arm.flange_jacobian(q), compute_uv=False)[-1] for q in drawn]
    return drawn[int(np.argmax(smallest))]


@pytest.fixture(scope="module")
def scene(any_arm):
    return Scene(any_arm, WORLD_T_BASE, FLANGE_T_CAMERA, preset("fe185"), bent(any_arm))


def test_every_joint_has_a_range_a_speed_and_an_acceleration(any_arm):
    assert any_arm.dof in (6, 7)
    assert len(set(any_arm.joint_names)) == any_arm.dof
    assert any_arm.joint_range.shape == (any_arm.dof, 2)
    assert (any_arm.joint_range[:, 0] < any_arm.joint_range[:, 1]).all()
    for rates in (any_arm.joint_speed, any_arm.joint_acceleration):
        assert rates.shape == (any_arm.dof,)
        assert (rates > 0.0).all()


def test_camera_jacobian_equals_finite_differences(any_arm):
    step = 1e-6
    for q in random_joints(any_arm, 5, 3):
        here = any_arm.base_T_flange(q) * FLANGE_T_CAMERA
        found = any_arm.camera_jacobian(q, FLANGE_T_CAMERA)
        for joint, change in enumerate(step * np.eye(any_arm.dof)):
            ahead = here.inv() * any_arm.base_T_flange(q + change) * FLANGE_T_CAMERA
            behind = here.inv() * any_arm.base_T_flange(q - change) * FLANGE_T_CAMERA
            linear = (ahead.translation - behind.translation) / (2 * step)
            angular = (ahead.rotation.as_rotvec() - behind.rotation.as_rotvec()) / (2 * step)
            np.testing.assert_allclose(found[:, joint], [*linear, *angular], atol=1e-8)


def test_joint_velocities_reproduce_the_twist_with_the_least_motion(any_arm):
    q, twist = bent(any_arm), np.array([0.02, -0.05, 0.1, 0.3, -0.2, 0.1])
    jacobian = any_arm.camera_jacobian(q, FLANGE_T_CAMERA)
    velocities = any_arm.joint_velocities(q, twist, FLANGE_T_CAMERA)
    np.testing.assert_allclose(jacobian @ velocities, twist, atol=1e-12)
    least = np.linalg.lstsq(jacobian, twist)[0]
    np.testing.assert_allclose(velocities, least, atol=1e-10)


def test_a_wish_moves_the_joints_but_not_the_camera(any_arm):
    q, twist = bent(any_arm), np.array([0.02, -0.05, 0.1, 0.3, -0.2, 0.1])
    jacobian = any_arm.camera_jacobian(q, FLANGE_T_CAMERA)
    wish = np.linspace(-0.5, 0.7, any_arm.dof)
    velocities = any_arm.joint_velocities(q, twist, FLANGE_T_CAMERA, wish)
    np.testing.assert_allclose(jacobian @ velocities, twist, atol=1e-12)
    own = jacobian @ wish  # a wish that moves the camera as commanded is what comes out
    np.testing.assert_allclose(any_arm.joint_velocities(q, own, FLANGE_T_CAMERA, wish), wish, atol=1e-10)


def test_inverse_near_follows_a_way_in_small_steps(any_arm):
    start, ahead = bent(any_arm), bent(any_arm) + 0.2
    joints = start
    for q in np.linspace(start, ahead, 11):
        goal = any_arm.base_T_flange(q)
        before, joints = joints, any_arm.inverse_near(goal, joints)
        np.testing.assert_allclose(any_arm.base_T_flange(joints).as_matrix(), goal.as_matrix(), atol=1e-9)
        assert any_arm.within_limits(joints)
        assert np.abs(joints - before).max() < 0.1


def test_every_inverse_reaches_the_pose_within_limits(any_arm):
    q = random_joints(any_arm, 1, 4)[0]
    goal = any_arm.base_T_flange(q)
    found = any_arm.inverse(goal)
    assert len(found)
    assert sorted(map(tuple, found)) == [tuple(joints) for joints in found]
    for joints in found:
        assert any_arm.within_limits(joints)
        np.testing.assert_allclose(any_arm.base_T_flange(joints).as_matrix(), goal.as_matrix(), atol=1e-8)


def test_six_joints_have_the_branch_that_the_pose_was_made_with(any_arm):
    if any_arm.dof == 6:
        q = bent(any_arm)
        found = any_arm.inverse(any_arm.base_T_flange(q))
        assert np.abs(found - q).max(axis=1).min() < 1e-6


def test_pose_out_of_reach_is_refused(any_arm):
    with pytest.raises(InputError, match="reach"):
        any_arm.inverse_near(RigidTransform.from_translation([1.7, 0, 0.3]), bent(any_arm))


def test_no_posture_reaches_farther_than_the_reach(any_arm):
    places = [any_arm.base_T_flange(q).translation for q in random_joints(any_arm, 300, 5)]
    far = max(np.linalg.norm(place[:2]) for place in places)  # every first axis here is the base's z
    assert far <= any_arm.reach < 1.5 * far


def test_singular_arm_refuses_to_move(any_arm):
    def smallest(q):
        jacobian = any_arm.camera_jacobian(q, FLANGE_T_CAMERA)
        jacobian[:3] /= LENGTH_SCALE
        return np.linalg.svd(jacobian, compute_uv=False)[-1]

    start = min(random_joints(any_arm, 100, 6), key=smallest)
    worst = minimize(smallest, start, method="Nelder-Mead", bounds=any_arm.joint_range)
    assert worst.fun < SINGULAR_VALUE
    with pytest.raises(JointLimit, match="singular"):
        any_arm.joint_velocities(worst.x, [0, 0, 0.1, 0, 0, 0], FLANGE_T_CAMERA)


def between(any_arm, low, high):
    """Joints whose smallest singular value lies between two."""
    for begin in random_joints(any_arm, 100, 6):
        for q in np.linspace(bent(any_arm), begin, 200):
            found = np.linalg.svd(any_arm.scaled_camera_jacobian(q, FLANGE_T_CAMERA), compute_uv=False)[-1]
            if low < found < high:
                return q
    raise AssertionError("none")


def test_near_a_singularity_joints_go_their_planned_way_where_the_twist_hardly_determines_it(any_arm):
    q = between(any_arm, LEAST_SINGULAR_VALUE + 1e-3, SINGULAR_VALUE - 2e-3)
    twist, wish = np.array([0.02, -0.05, 0.1, 0.3, -0.2, 0.1]), np.linspace(-0.5, 0.7, any_arm.dof)
    scaled = any_arm.scaled_camera_jacobian(q, FLANGE_T_CAMERA)
    left, values, right = np.linalg.svd(scaled, full_matrices=False)
    with pytest.raises(JointLimit, match=f"at least {SINGULAR_VALUE:g} is needed"):
        any_arm.joint_velocities(q, twist, FLANGE_T_CAMERA)
    found = any_arm.joint_velocities(q, twist, FLANGE_T_CAMERA, wish)
    asked = twist / np.repeat([LENGTH_SCALE, 1.0], 3)
    np.testing.assert_allclose((left.T @ (scaled @ found - asked))[:-1], 0.0, atol=1e-10)
    share = (values[-1] / SINGULAR_VALUE) ** 2
    mixed = share * (left[:, -1] @ asked) / values[-1] + (1.0 - share) * (right[-1] @ wish)
    assert right[-1] @ found == pytest.approx(mixed, abs=1e-10)


@pytest.mark.parametrize("bad", [[0, 0, 0], "upwards", [np.nan] * 6, [np.inf] * 7])
def test_wrong_joints_are_refused(any_arm, bad):
    with pytest.raises(InputError, match="q: "):
        any_arm.base_T_flange(bad)


def test_reading_an_arm_again_gives_the_same_arm(any_arm):
    again, q = Arm(any_arm.path), bent(any_arm)
    np.testing.assert_array_equal(again.joint_range, any_arm.joint_range)
    np.testing.assert_array_equal(again.flange_jacobian(q), any_arm.flange_jacobian(q))
    assert (again.flange, again.notices, again.links) == (any_arm.flange, any_arm.notices, any_arm.links)


def test_the_worlds_camera_is_where_the_kinematics_say(scene):
    world = World(scene)
    for q in random_joints(scene.arm, 5, 1):
        found = world.world_T_camera(world.data_at(q)).as_matrix()
        expected = WORLD_T_BASE * scene.arm.base_T_flange(q) * FLANGE_T_CAMERA
        np.testing.assert_allclose(found, expected.as_matrix(), atol=1e-12)


def test_arm_with_room_around_touches_nothing(scene):
    world = World(scene)
    assert world.touching(world.data_at(scene.start_joints)) == set()
    assert len(world.arm_geoms) >= scene.arm.dof


def test_gravity_does_not_pull(scene):
    robot = SimulatedRobot(scene)
    robot.advance(0.5)
    np.testing.assert_allclose(robot.read().joint_positions, scene.start_joints, atol=1e-4)


def test_simulated_joints_follow_velocity_commands(scene):
    robot, speed = SimulatedRobot(scene), 0.2 * np.resize([1.0, -1.0], scene.arm.dof)
    robot.command(speed)
    robot.advance(0.3)
    ramp = np.abs(speed) / scene.arm.joint_acceleration
    moved = speed * (0.3 - 0.5 * ramp)
    state = robot.read()
    np.testing.assert_allclose(state.joint_positions - scene.start_joints, moved, atol=2e-3)
    np.testing.assert_allclose(state.joint_velocities, speed, atol=5e-3)
    robot.stop()
    robot.advance(0.3)
    assert np.abs(robot.read().joint_velocities).max() < 1e-3


def test_model_has_one_drive_a_joint_and_no_gravity_of_its_own(any_arm):
    model = any_arm.spec().compile()
    assert model.nu == model.njnt == any_arm.dof
    assert (model.jnt_type == mujoco.mjtJoint.mjJNT_HINGE).all()
    moving = model.body_weldid != 0
    assert (model.body_gravcomp[moving] == 1.0).all()
