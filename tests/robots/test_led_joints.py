"""Seven joints led to a posture, or leaving with a velocity: what the camera leaves free of it they do."""

import numpy as np
import pytest
from scipy.integrate import solve_ivp
from tests.robots.test_joint_path import (
    CURVE,
    FLANGE_T_CAMERA,
    STARTS,
    camera_error,
    flow_of,
    scaled_jacobian,
)

from omniservo.errors import InputError
from omniservo.robots import follow_path
from omniservo.robots.path_following.path_steps import PULL
from omniservo.robots.path_following.step_kernels import FADED


@pytest.fixture(scope="module")
def led(load):
    """A Panda on the curve, led to each of the postures at its end that are nearest to where it begins."""
    arm = load("panda")
    start = np.array(STARTS["panda"])
    base_T_initial = arm.base_T_flange(start) * FLANGE_T_CAMERA
    ends = arm.inverse(base_T_initial * CURVE(1.0) * FLANGE_T_CAMERA.inv())
    aims = ends[np.argsort(np.abs(ends - start).max(axis=1))][:6]
    paths = [follow_path(arm, CURVE, base_T_initial, FLANGE_T_CAMERA, start=start, aim=a).best for a in aims]
    return arm, base_T_initial, start, aims, paths


def test_seven_joints_that_are_led_to_a_posture_end_near_it_with_the_camera_on_its_path(led):
    arm, base_T_initial, start, aims, paths = led
    alone = follow_path(arm, CURVE, base_T_initial, FLANGE_T_CAMERA, start=start).best
    reached = 0
    for aim, branch in zip(aims, paths, strict=True):
        for w in np.linspace(0.0, branch.w[-1], 23):
            assert camera_error(arm, base_T_initial, branch(w), w) < 1e-6
        if branch.w[-1] == 1.0:
            assert np.linalg.norm(branch(1.0) - aim) < np.linalg.norm(alone(1.0) - aim) + 1e-6
            reached += np.abs(branch(1.0) - aim).max() < 0.1
    assert reached >= 2


def test_accelerations_of_led_joints_are_the_derivative_of_their_flow(led):
    """J q′ = ξ and, across J, the wish l′ + k(l − q) beside the push: the flow derived by differences."""
    arm, _, start, aims, paths = led
    plain = flow_of(arm)

    def flow(w, q, aim):
        jacobian = scaled_jacobian(arm, q)
        across = np.eye(7) - np.linalg.pinv(jacobian) @ jacobian
        line = start + w * (aim - start)
        return plain(w, q) + across @ (aim - start + PULL * (line - q))

    step = 1e-6
    for aim, branch in zip(aims[:2], paths[:2], strict=True):
        for i in range(0, len(branch.w), 7):
            w, q, slope = branch.w[i], branch.positions[i], branch.velocities[i]
            np.testing.assert_allclose(flow(w, q, aim), slope, atol=1e-7)
            along = (flow(w + step, q + step * slope, aim) - flow(w - step, q - step * slope, aim)) / (
                2 * step
            )
            if branch.singular_values[i] > 0.1:
                np.testing.assert_allclose(along, branch.accelerations[i], atol=1e-4)


def test_seven_joints_leave_with_the_velocity_that_is_asked_for_and_it_fades(load):
    """A self-motion of 0.8 rad per unit w at w = 0, nothing of it from w = 1/4 on."""
    arm, step = load("panda"), 1e-6
    start = np.array(STARTS["panda"])
    base_T_initial = arm.base_T_flange(start) * FLANGE_T_CAMERA
    plain = flow_of(arm)
    free = np.linalg.svd(scaled_jacobian(arm, start))[2][-1]
    velocity = plain(0.0, start) + 0.8 * free
    branch = follow_path(arm, CURVE, base_T_initial, FLANGE_T_CAMERA, start=start, velocity=velocity).best
    assert branch.w[-1] == 1.0
    np.testing.assert_allclose(branch(0.0, 1), velocity, atol=1e-9)

    def flow(w, q):
        jacobian = scaled_jacobian(arm, q)
        across = np.eye(7) - np.linalg.pinv(jacobian) @ jacobian
        u = min(w / FADED, 1.0)
        return plain(w, q) + across @ (0.8 * free) * (1.0 - 3.0 * u**2 + 2.0 * u**3)

    solved = solve_ivp(flow, (0, 1), start, "DOP853", t_eval=branch.w, rtol=1e-9, atol=1e-11)
    np.testing.assert_allclose(branch.positions, solved.y.T, atol=1e-6)
    for w, q, slope, bend in zip(
        branch.w, branch.positions, branch.velocities, branch.accelerations, strict=True
    ):
        np.testing.assert_allclose(flow(w, q), slope, atol=1e-7)
        if step < w < 1.0 - step:
            ahead, behind = flow(w + step, q + step * slope), flow(w - step, q - step * slope)
            np.testing.assert_allclose((ahead - behind) / (2 * step), bend, atol=1e-4)
        assert camera_error(arm, base_T_initial, q, w) < 1e-9
    after = branch.w >= FADED
    for w, q, slope in zip(branch.w[after], branch.positions[after], branch.velocities[after], strict=True):
        np.testing.assert_allclose(plain(w, q), slope, atol=1e-7)


def test_an_aim_needs_a_start_and_a_joint_to_spare(load):
    for name, start in (("panda", None), ("ur5e", STARTS["ur5e"])):
        arm = load(name)
        base_T_initial = arm.base_T_flange(STARTS[name]) * FLANGE_T_CAMERA
        with pytest.raises(InputError, match="aim: needs a start, and an arm of seven joints"):
            follow_path(arm, CURVE, base_T_initial, FLANGE_T_CAMERA, start=start, aim=STARTS[name])
        with pytest.raises(InputError, match="velocity: needs a start, and an arm of seven joints"):
            follow_path(arm, CURVE, base_T_initial, FLANGE_T_CAMERA, start=start, velocity=np.zeros(arm.dof))
