"""An uncertain camera mount: what it may take from gaps is what sampled mounts take."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import RigidTransform
from tests.planning.arm_scenes import random_task

from omniservo.errors import InputError
from omniservo.planning import plan_with_arm, plan_with_mount
from omniservo.planning.with_arm.mount_margin import gap_slopes, mount_margin
from omniservo.robots import load_arm

COVARIANCE = np.diag([1e-6, 4e-6, 2e-6, 1e-6, 3e-6, 2e-6])
"""1 to 2 mm, 1 to 1.7 mrad"""


@pytest.fixture(scope="module")
def planned():
    arm = load_arm("rx60")
    for seed in range(50):
        problem, setting = random_task(arm, np.random.default_rng([4, seed]))
        found = plan_with_arm(problem, setting)
        if not found.certified:
            continue
        bodies = setting.bodies(problem.obstacles)
        if len(gap_slopes(setting, bodies, found.plan.path(0.5), found.branch(0.5))):
            return problem, setting, found
    raise AssertionError("none of 50 plans comes near anything")


def gap_with(problem, setting, found, w, xi, pair):
    """The pair's gap where the true mount is flange_T_camera · exp(ξ) and the camera is on its path."""
    error = RigidTransform.from_exp_coords(np.concatenate([xi[3:], xi[:3]]))
    mount = setting.flange_T_camera * error
    base_T_flange = setting.base_T_initial * setting.flange_T_camera.inv()
    base_T_initial = base_T_flange * mount
    flange = base_T_initial * found.plan.path(w) * mount.inv()
    q = setting.arm.inverse_near(flange, found.branch(w))
    truth = replace(setting, base_T_initial=base_T_initial, start=None)
    bodies = truth.bodies(problem.obstacles)
    bodies.place(q)
    return bodies.measure(pair)


def test_slopes_are_finite_differences_of_gaps_with_another_mount(planned):
    problem, setting, found = planned
    bodies, checked = setting.bodies(problem.obstacles), 0
    for w in (0.3, 0.5, 0.7):
        slopes = gap_slopes(setting, bodies, found.plan.path(w), found.branch(w))
        bodies.place(found.branch(w))
        pairs = [n.pair for n in bodies.near(setting.clearance_around + 0.1) if bodies.is_around(n.pair)]
        for slope, pair in zip(slopes, pairs, strict=True):
            numeric = [
                (
                    gap_with(problem, setting, found, w, 1e-6 * unit, pair)
                    - gap_with(problem, setting, found, w, -1e-6 * unit, pair)
                )
                / 2e-6
                for unit in np.eye(6)
            ]
            checked += np.allclose(slope, numeric, atol=5e-3)
            np.testing.assert_allclose(slope, numeric, atol=0.05)
    assert checked >= 3


def test_the_margin_covers_all_sampled_mounts_but_the_risk(planned):
    problem, setting, found = planned
    bodies, w, random = setting.bodies(problem.obstacles), 0.5, np.random.default_rng(1)
    margin = mount_margin(setting, bodies, found.plan.path, found.branch, COVARIANCE, 0.05)
    assert 1e-3 < margin < 0.05
    bodies.place(found.branch(w))
    near = [n for n in bodies.near(setting.clearance_around + 0.1) if bodies.is_around(n.pair)]
    to_camera = np.eye(6)
    to_camera[:3, :3] = setting.flange_T_camera.rotation.as_matrix().T
    taken = []
    for sample in random.multivariate_normal(np.zeros(6), COVARIANCE, 150):
        xi = to_camera @ sample
        taken.append(max(n.gap - gap_with(problem, setting, found, w, xi, n.pair) for n in near[:3]))
    assert np.mean(np.array(taken) > margin) <= 0.05
    assert max(taken) > 0.1 * margin


def test_clearance_is_added_until_it_covers_the_mount(planned):
    problem, setting, _ = planned
    found, added = plan_with_mount(problem, setting, COVARIANCE, 0.05)
    if found.certified:
        bodies = setting.bodies(problem.obstacles)
        needed = mount_margin(setting, bodies, found.plan.path, found.branch, COVARIANCE, 0.05)
        assert found.clearance.clearance == pytest.approx(setting.clearance + added)
        assert needed <= added + 1e-4
    else:
        assert found.plan.reason
    nothing, none = plan_with_mount(problem, setting, np.zeros((6, 6)), 0.05)
    assert nothing.certified
    assert none == 0.0


def test_wrong_covariance_and_risk_are_named(planned):
    problem, setting, _ = planned
    with pytest.raises(InputError, match="covariance"):
        plan_with_mount(problem, setting, np.full((6, 6), np.nan), 0.05)
    with pytest.raises(InputError, match="risk"):
        plan_with_mount(problem, setting, COVARIANCE, 0.0)
