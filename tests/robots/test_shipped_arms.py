"""The shipped arms against their makers' tables: Denavit–Hartenberg products, ranges, speeds, reach."""

import mujoco
import numpy as np
import pytest
from scipy.optimize import differential_evolution

from omniservo.errors import InputError
from omniservo.robots import load_arm, shipped_arms

# Universal Robots, "DH Parameters for calculations of kinematics and dynamics", UR5e, the usual convention:
# Rz(θ) Tz(d) Tx(a) Rx(α).   a [m], d [m], α [rad]
UR5E = [
    (0, 0.1625, np.pi / 2),
    (-0.425, 0, 0),
    (-0.3922, 0, 0),
    (0, 0.1333, np.pi / 2),
    (0, 0.0997, -np.pi / 2),
    (0, 0.0996, 0),
]
# Franka Control Interface documentation, "Denavit–Hartenberg parameters", Craig's convention:
# Rx(α) Tx(a) Rz(θ) Tz(d).   a [m], d [m], α [rad]; the last row is the flange.
PANDA = [
    (0, 0.333, 0),
    (0, 0, -np.pi / 2),
    (0, 0.316, np.pi / 2),
    (0.0825, 0, np.pi / 2),
    (-0.0825, 0.384, -np.pi / 2),
    (0, 0, np.pi / 2),
    (0.088, 0, np.pi / 2),
    (0, 0.107, 0),
]


def about_x(angle, along):
    c, s = np.cos(angle), np.sin(angle)
    return np.array([[1, 0, 0, along], [0, c, -s, 0], [0, s, c, 0], [0, 0, 0, 1]])


def about_z(angle, along):
    c, s = np.cos(angle), np.sin(angle)
    return np.array([[c, -s, 0, 0], [s, c, 0, 0], [0, 0, 1, along], [0, 0, 0, 1]])


def ur5e_by_table(q):
    return np.linalg.multi_dot(
        [
            step
            for (a, d, alpha), angle in zip(UR5E, q, strict=True)
            for step in (about_z(angle, d), about_x(alpha, a))
        ]
    )


def panda_by_table(q):
    return np.linalg.multi_dot(
        [
            step
            for (a, d, alpha), angle in zip(PANDA, [*q, 0.0], strict=True)
            for step in (about_x(alpha, a), about_z(angle, d))
        ]
    )


@pytest.mark.parametrize(("name", "by_table"), [("ur5e", ur5e_by_table), ("panda", panda_by_table)])
def test_forward_kinematics_equal_the_makers_dh_table(name, by_table):
    arm = load_arm(name)
    for q in np.random.default_rng(1).uniform(*arm.joint_range.T, (100, arm.dof)):
        np.testing.assert_allclose(arm.base_T_flange(q).as_matrix(), by_table(q), atol=1e-12)


def test_ur5e_stretched_out_lies_where_the_maker_draws_it():
    """All joints 0: stretched along −x, the flange looks along −y, d4 + d6 to the side, d5 below the arm."""
    pose = load_arm("ur5e").base_T_flange(np.zeros(6))
    np.testing.assert_allclose(pose.translation, [-0.8172, -0.2329, 0.0628], atol=1e-12)
    np.testing.assert_allclose(pose.rotation.apply([0, 0, 1]), [0, -1, 0], atol=1e-12)


def test_panda_in_its_ready_posture_holds_the_hand_down():
    """The maker's start posture 0, −π/4, 0, −3π/4, 0, π/2, π/4: the flange 0.307 m ahead, 0.590 m up."""
    ready = np.array([0, -1, 0, -3, 0, 2, 1]) * np.pi / 4
    pose = load_arm("panda").base_T_flange(ready)
    np.testing.assert_allclose(pose.translation, [0.3069, 0, 0.5903], atol=1e-4)
    np.testing.assert_allclose(pose.rotation.apply([0, 0, 1]), [0, 0, -1], atol=1e-12)


def test_ur5e_ranges_speeds_and_torques_are_the_makers():
    arm = load_arm("ur5e")
    np.testing.assert_allclose(np.rad2deg(arm.joint_range), [[-360, 360]] * 6)
    np.testing.assert_allclose(np.rad2deg(arm.joint_speed), 180)
    np.testing.assert_allclose(arm.joint_effort, [150, 150, 150, 28, 28, 28])


def test_panda_ranges_speeds_accelerations_and_torques_are_the_makers():
    arm = load_arm("panda")
    low = [-2.8973, -1.7628, -2.8973, -3.0718, -2.8973, -0.0175, -2.8973]
    high = [2.8973, 1.7628, 2.8973, -0.0698, 2.8973, 3.7525, 2.8973]
    np.testing.assert_allclose(arm.joint_range, np.transpose([low, high]), atol=1e-12)
    np.testing.assert_allclose(arm.joint_speed, [2.175] * 4 + [2.61] * 3, atol=1e-12)
    np.testing.assert_allclose(arm.joint_acceleration, [15, 7.5, 10, 12.5, 15, 20, 20], atol=1e-12)
    np.testing.assert_allclose(arm.joint_effort, [87] * 4 + [12] * 3)


def test_rx60_reaches_as_far_as_its_links_are_long():
    """Upper arm and forearm in line, the elbow's offset across, the flange straight away from axis 1."""
    assert load_arm("rx60").reach == pytest.approx(np.hypot(0.290 + 0.310, 0.049) + 0.065, abs=1e-6)


@pytest.mark.parametrize(("name", "by_table"), [("ur5e", ur5e_by_table), ("panda", panda_by_table)])
def test_reach_is_what_a_global_search_of_the_makers_table_finds(name, by_table):
    arm = load_arm(name)
    search = differential_evolution(
        lambda q: -np.hypot(*by_table([0.0, *q])[:2, 3]), arm.joint_range[1:], rng=0, maxiter=60, popsize=8
    )
    assert arm.reach == pytest.approx(-search.fun, abs=1e-4)


def test_every_shipped_file_names_its_source():
    for name in shipped_arms():
        words = load_arm(name).path.read_text()[:1500]
        assert "maker's" in words
        assert load_arm(name).name == name


@pytest.mark.parametrize("name", shipped_arms())
def test_links_that_carry_each_other_never_count_as_touching(name):
    arm = load_arm(name)
    model = arm.spec().compile()
    data = mujoco.MjData(model)
    for q in np.random.default_rng(2).uniform(*arm.joint_range.T, (60, arm.dof)):
        data.qpos[:] = q
        mujoco.mj_forward(model, data)
        for bodies in model.geom_bodyid[data.contact.geom]:
            a, b = sorted(bodies)
            assert model.body_parentid[b] != a


def test_a_shipped_arm_is_read_once_and_anew_for_another_flange():
    assert load_arm("rx60") is load_arm("rx60")
    with pytest.raises(InputError, match="flange 'wrist'"):
        load_arm("rx60", flange="wrist")
