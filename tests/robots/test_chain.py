"""The compiled chain against MuJoCo, SciPy, NumPy and finite differences."""

import mujoco
import numpy as np
import pytest
from scipy.spatial.transform import RigidTransform, Rotation

from omniservo.robots import Arm
from omniservo.robots.arm import LENGTH_SCALE
from omniservo.robots.kinematics.chain import least_motion
from omniservo.robots.kinematics.numeric_inverse import descend_all, solutions
from omniservo.robots.kinematics.posture import sensitivities
from omniservo.robots.kinematics.twist_matrix import twist_matrix
from omniservo.robots.path_following.step_kernels import (
    LEAST,
    SLOPE,
    TAKEN,
    VALUE,
    Aim,
    JointState,
    Rule,
    advance,
)

FLANGE_T_CAMERA = RigidTransform.from_components([0.03, -0.02, 0.09], Rotation.from_rotvec([0.3, -0.8, 1.1]))
TO_CAMERA = twist_matrix(FLANGE_T_CAMERA, LENGTH_SCALE)


def oblique_chain(folder, seed):
    """Hinges beside their bodies' origins, two on one body, with references off zero, in turned bodies."""
    random = np.random.default_rng(seed)

    def words(values):
        return " ".join(f"{v:.17g}" for v in values)

    head, tail, joint, count = "", "", 0, 6 + seed % 2
    while joint < count:
        pos, quat = random.uniform(-0.3, 0.3, 3), random.normal(size=4)
        head += f'<body pos="{words(pos)}" quat="{words(quat)}">'
        head += '<inertial pos="0 0 0" mass="1" diaginertia="1 1 1"/>'
        for _ in range(min(random.integers(1, 3), count - joint)):
            at, axis = random.uniform(-0.2, 0.2, 3), random.normal(size=3)
            head += (
                f'<joint pos="{words(at)}" axis="{words(axis)}" ref="{random.uniform(-1, 1)}" range="-3 3"/>'
            )
            joint += 1
        tail += "</body>"
    path = folder / f"oblique{seed}.xml"
    speeds = f'<custom><numeric name="joint_speed_deg_s" data="{"180 " * count}"/></custom>'
    head += '<site name="flange" pos="0.1 -0.2 0.3" quat="0.3 0.4 -0.5 0.6"/>'
    path.write_text(
        f'<mujoco><compiler angle="radian" autolimits="true"/>{speeds}'
        f"<worldbody>{head}{tail}</worldbody></mujoco>"
    )
    return Arm(path), mujoco.MjModel.from_xml_path(str(path))


def mujocos(model, q):
    """Pose (3, 4) of the site, and its Jacobian in its own frame (6, n)."""
    data, J = mujoco.MjData(model), np.zeros((6, model.nv))
    data.qpos[:] = q
    mujoco.mj_kinematics(model, data)
    mujoco.mj_comPos(model, data)
    mujoco.mj_jacSite(model, data, J[:3], J[3:], 0)
    R = data.site_xmat[0].reshape(3, 3)
    return np.column_stack([R, data.site_xpos[0]]), np.concatenate([R.T @ J[:3], R.T @ J[3:]])


@pytest.mark.parametrize("seed", range(6))
def test_place_and_jacobian_of_any_chain_of_hinges_are_mujocos(tmp_path, seed):
    arm, model = oblique_chain(tmp_path, seed)
    for q in np.random.default_rng(seed).uniform(-3, 3, (50, arm.dof)):
        pose, J = mujocos(model, q)
        np.testing.assert_allclose(arm.base_T_flange(q).as_matrix()[:3], pose, atol=1e-12)
        np.testing.assert_allclose(arm.flange_jacobian(q), J, atol=1e-12)


def test_place_and_jacobian_of_every_arm_are_those_of_its_mujoco_model(any_arm):
    model = any_arm.spec().compile()
    body = model.body(any_arm.flange_link).id
    data, J = mujoco.MjData(model), np.zeros((6, any_arm.dof))
    for q in np.random.default_rng(1).uniform(*any_arm.joint_range.T, (50, any_arm.dof)):
        data.qpos[:] = q
        mujoco.mj_kinematics(model, data)
        mujoco.mj_comPos(model, data)
        link = RigidTransform.from_components(
            data.xpos[body], Rotation.from_matrix(data.xmat[body].reshape(3, 3))
        )
        expected = link * any_arm.link_T_flange
        mujoco.mj_jac(model, data, J[:3], J[3:], expected.translation, body)
        back = expected.rotation.as_matrix().T
        np.testing.assert_allclose(any_arm.base_T_flange(q).as_matrix(), expected.as_matrix(), atol=1e-12)
        found = any_arm.flange_jacobian(q)
        np.testing.assert_allclose(found, [*(back @ J[:3]), *(back @ J[3:])], atol=1e-12)


@pytest.mark.parametrize("angle", [0.0, 1e-14, 1e-9, 1e-3, 1.0, 2.0, np.pi - 1e-3, np.pi - 1e-9])
def test_what_a_pose_is_missed_by_is_scipys_rotation_vector(load, angle):
    arm, random = load("rx60"), np.random.default_rng(2)
    for axis in [*random.normal(size=(20, 3)), *np.eye(3), *-np.eye(3)]:
        here = arm.base_T_flange(random.uniform(*arm.joint_range.T))
        turn, way = angle * axis / np.linalg.norm(axis), random.normal(size=3)
        goal = here * RigidTransform.from_components(way, Rotation.from_rotvec(turn))
        q = arm.inverse(here)[0]
        twist, _ = arm.miss(q, goal.as_matrix())
        np.testing.assert_allclose(LENGTH_SCALE * twist[:3], way, atol=1e-9)
        np.testing.assert_allclose(twist[3:], turn, atol=3e-8 if angle > 3 else 1e-9)


def test_the_least_motion_is_the_pseudo_inverses_and_none_where_rows_are_missing():
    random, motion = np.random.default_rng(3), np.empty(7)
    J, twist = random.normal(size=(6, 7)), random.normal(size=6)
    assert least_motion(J, 0.0, twist, motion)
    np.testing.assert_allclose(motion, np.linalg.pinv(J) @ twist, atol=1e-12)
    J[5] = 0.0
    assert not least_motion(J, 0.0, twist, motion)
    assert least_motion(J, 0.01, twist, motion)
    damped = J.T @ np.linalg.solve(J @ J.T + 0.01 * np.eye(6), twist)
    np.testing.assert_allclose(motion, damped, atol=1e-12)


def test_the_smallest_singular_value_is_numpys_and_its_slope_a_finite_difference(any_arm):
    def smallest(q):
        return np.linalg.svd(any_arm.scaled_camera_jacobian(q, FLANGE_T_CAMERA), compute_uv=False)

    n = any_arm.dof
    to_joints, slope = np.empty((n, 6)), np.empty(n)
    checked = 0
    for q in np.random.default_rng(4).uniform(*any_arm.joint_range.T, (40, n)):
        value = sensitivities(any_arm.chain, TO_CAMERA, q, to_joints, slope)
        values = smallest(q)
        assert abs(value - values[-1]) < 1e-10
        if values[-1] < 0.02 or values[-2] - values[-1] < 0.02:
            continue
        checked += 1
        numeric = [(smallest(q + s)[-1] - smallest(q - s)[-1]) / 2e-6 for s in 1e-6 * np.eye(n)]
        np.testing.assert_allclose(slope, numeric, atol=1e-7)
        inverse = np.linalg.pinv(any_arm.camera_jacobian(q, FLANGE_T_CAMERA))
        np.testing.assert_allclose(to_joints, inverse, atol=1e-8 * np.abs(inverse).max())
    assert checked > 5


def test_near_a_singularity_no_camera_motion_asks_for_boundless_joints(load):
    arm, to_joints = load("rx60"), np.empty((6, 6))
    for bent in (0.0, 1e-4, 1e-3):
        q = np.array([0.0, 0.75, -1.1, 0.2, bent, 0.3])
        assert sensitivities(arm.chain, TO_CAMERA, q, to_joints, np.empty(6)) < bent + 1e-7
        assert np.linalg.norm(to_joints, 2) <= 1.01e3 / LENGTH_SCALE


def test_a_step_tells_how_the_smallest_singular_value_changes_on_its_way(load):
    """dσ/dw of a state, against σ of the states a little before and after."""
    arm = load("ur5e")
    begin = np.array([0.0, -1.5, 1.5, -1.5, -1.5, 0.1])
    pose = arm.base_T_flange(begin)
    motion = np.array([[0.3, -0.2, 0.4, 0.2, 0.1, -0.3], np.zeros(6)])  # in the flange's frame
    rule = Rule(
        twist_matrix(RigidTransform.identity(), LENGTH_SCALE),
        np.zeros(1),
        np.zeros((2, arm.dof)),
        np.zeros(1),
        np.zeros(arm.dof),
    )

    def state(w):
        turn = RigidTransform.from_exp_coords(
            np.concatenate([motion[0, 3:], LENGTH_SCALE * motion[0, :3]]) * w
        )
        goal, joints, values = (pose * turn).as_matrix(), np.empty((3, 6)), np.empty(3)
        now = JointState(np.array([begin, np.zeros(6), np.zeros(6)]), np.array([np.inf, 0.0, 0.0]))
        aim, end = Aim(goal, motion, goal), JointState(joints, values)
        assert advance(arm.chain, rule, 0.0, 0.0, now, aim, end) == TAKEN
        return joints, values

    (_, behind), (here, values), (_, ahead) = (state(w) for w in (-1e-5, 0.0, 1e-5))
    assert values[LEAST] == values[VALUE]
    assert abs((ahead[VALUE] - behind[VALUE]) / 2e-5 - values[SLOPE]) < 1e-6
    np.testing.assert_allclose(arm.scaled_flange_jacobian(begin) @ here[1], motion[0], atol=1e-12)


@pytest.mark.parametrize("joint", range(6))
def test_a_descent_that_one_joint_alone_can_move_ends_at_the_goal_or_says_that_it_does_not(load, joint):
    arm = load("urdf of six")
    q = np.array([0.3, -0.5, 0.8, 0.2, 0.9, 0.1])
    ranges = np.stack([q, q], axis=1)
    ranges[joint] = q[joint] + [-0.5, 0.5]
    chain = arm.chain._replace(ranges=ranges)
    for ahead, reached in ((0.4, True), (-0.499, True), (0.6, False)):
        there = q.copy()
        there[joint] += ahead
        found = descend_all(chain, arm.base_T_flange(there).as_matrix(), q[None].copy())
        assert len(found) == reached
        if reached:
            np.testing.assert_allclose(found[0], there, atol=1e-8)


def test_a_search_finds_what_it_started_from_and_nothing_twice(load):
    arm = load("urdf of six")
    for q in np.random.default_rng(6).uniform(*arm.joint_range.T, (5, 6)):
        goal = arm.base_T_flange(q).as_matrix()
        found = solutions(arm.chain, goal)
        for posture in found:
            np.testing.assert_allclose(arm.base_T_flange(posture).as_matrix(), goal, atol=1e-9)
            assert arm.within_limits(posture)
        apart = np.abs(found[:, None] - found[None]).max(axis=-1) + np.eye(len(found))
        assert apart.min() > 1e-6
        assert np.abs(descend_all(arm.chain, goal, q[None]) - q).max() < 1e-9
