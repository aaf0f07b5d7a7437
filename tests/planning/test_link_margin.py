"""An uncertain camera mount and estimate: what they take from gaps is what sampled ones take."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import RigidTransform
from tests.planning.arm_scenes import random_task

from omniservo.errors import InputError
from omniservo.estimation import estimate_two_view
from omniservo.planning import Executions, plan_arm_with_risk, plan_links_at_risk, plan_with_arm
from omniservo.planning.with_arm.gap_slopes import gap_slopes
from omniservo.planning.with_arm.link_margin import resting_moves, taken_by
from omniservo.robots import Tube, load_arm

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
        if len(gap_slopes(setting, bodies, found.plan.path(0.5), found.branch(0.5)).left):
            return problem, setting, found
    raise AssertionError("none of 50 plans comes near anything")


def gap_with(problem, setting, found, w, xi, pair, move=None):
    """The pair's gap where the true mount is flange_T_camera · exp(ξ) and the camera is beside its path."""
    mount = setting.flange_T_camera * twisted(xi)
    base_T_flange = setting.base_T_initial * setting.flange_T_camera.inv()
    base_T_initial = base_T_flange * mount
    beside = RigidTransform.identity() if move is None else twisted(move)
    flange = base_T_initial * found.plan.path(w) * beside * mount.inv()
    q = setting.arm.inverse_near(flange, found.branch(w))
    truth = replace(setting, base_T_initial=base_T_initial, start=None)
    bodies = truth.bodies(problem.obstacles)
    bodies.place(q)
    return bodies.measure(pair)


def twisted(xi):
    return RigidTransform.from_exp_coords(np.concatenate([xi[3:], xi[:3]]))


def test_slopes_are_finite_differences_of_gaps_with_another_mount_and_another_way(planned):
    problem, setting, found = planned
    bodies, checked, none = setting.bodies(problem.obstacles), 0, np.zeros(6)
    for w in (0.3, 0.5, 0.7):
        slopes = gap_slopes(setting, bodies, found.plan.path(w), found.branch(w))
        bodies.place(found.branch(w))
        pairs = [n.pair for n in bodies.near(setting.clearance_around + 0.1) if bodies.is_around(n.pair)]
        for k, pair in enumerate(pairs):
            for slope, errors in (
                (slopes.by_mount[k], lambda step: (step, None)),
                (slopes.by_move[k], lambda step: (none, step)),
            ):
                ends = [
                    [
                        gap_with(problem, setting, found, w, xi, pair, move)
                        for xi, move in map(errors, (u, -u))
                    ]
                    for u in 1e-6 * np.eye(6)
                ]
                numeric = np.diff(ends, axis=1)[:, 0] / -2e-6
                checked += np.allclose(slope, numeric, atol=5e-3)
                np.testing.assert_allclose(slope, numeric, atol=0.05)
    assert checked >= 6


def test_what_samples_take_is_what_the_gaps_of_those_mounts_lose(planned):
    problem, setting, found = planned
    bodies, random = setting.bodies(problem.obstacles), np.random.default_rng(1)
    mounts = random.multivariate_normal(np.zeros(6), COVARIANCE, 40)
    taken = taken_by(setting, bodies, found.plan.path, found.branch, mounts, None)
    bodies.place(found.branch(0.5))
    near = [n for n in bodies.near(setting.clearance_around + 0.1) if bodies.is_around(n.pair)]
    for k, xi in enumerate(mounts):
        lost = max(n.gap - gap_with(problem, setting, found, 0.5, xi, n.pair) for n in near)
        assert taken.mount[k] >= lost - 5e-4  # the most of 33 places is no less than that of one
    assert (taken.estimate == 0.0).all()
    assert taken.mount.max() > 1e-3


def test_points_that_are_farther_than_estimated_take_from_gaps_what_the_longer_way_does(planned):
    problem, setting, found = planned
    shares = (1.0, 1.05, 0.95)
    farther = np.stack([share * problem.points for share in shares])
    executions = Executions(problem, farther, np.zeros((3, 0)))
    bodies, w = setting.bodies(problem.obstacles), 0.5
    taken = taken_by(setting, bodies, found.plan.path, found.branch, np.zeros((3, 6)), executions)
    assert taken.estimate[0] < 1e-9
    pose, most = found.plan.path(w), []
    bodies.place(found.branch(w))
    near = [n for n in bodies.near(setting.clearance_around + 0.1) if bodies.is_around(n.pair)]
    for share, estimated in zip(shares[1:], taken.estimate[1:], strict=True):
        other = pose.inv() * RigidTransform.from_components(share * pose.translation, pose.rotation)
        move = np.concatenate([other.translation, np.zeros(3)])
        rest = resting_moves(executions, found.plan.path, w)[shares.index(share)]
        np.testing.assert_allclose(rest, move, atol=0.1 * np.linalg.norm(move))
        lost = [n.gap - gap_with(problem, setting, found, w, np.zeros(6), n.pair, move) for n in near]
        assert estimated >= max(lost) - 5e-4
        most.append(max(lost))
    assert max(most) > 1e-3


def test_clearance_is_added_until_the_samples_keep_what_is_asked(planned):
    problem, setting, _ = planned
    found, margin = plan_links_at_risk(problem, setting, 0.05, mount_covariance=COVARIANCE)
    assert found.certified, found.plan.reason
    assert margin.violated <= 0.05
    assert found.clearance.clearance == pytest.approx(setting.clearance + margin.added)
    assert margin.mount > 1e-3
    assert margin.estimate == 0.0
    exact, none = plan_links_at_risk(problem, setting, 0.05)
    assert exact.certified
    assert (none.added, none.mount, none.violated) == (0.0, 0.0, 0.0)


def test_what_links_stray_is_kept_by_every_pair_beyond_its_clearance(planned):
    problem, setting, _ = planned
    parts = setting.bodies(problem.obstacles).tube_parts
    strays = dict.fromkeys(parts, 0.004) | {"camera": 0.006, "camera & forearm": 0.003}
    tube = Tube(np.full(6, 0.01), strays, 0.006, 1.0, 0.02, 0.01)
    strayed = replace(setting, tube=tube)
    bodies, plain = strayed.bodies(problem.obstacles), setting.bodies(problem.obstacles)
    more = bodies.asked(0.01, 0.002) - plain.asked(0.01, 0.002)
    gaps, random = [], np.random.default_rng(4)
    for _ in range(10):
        plain.place(random.uniform(*setting.arm.joint_range.T))
        gaps.append([plain.measure(pair) for pair in range(len(more))])
    steady = np.ptp(gaps, axis=0) < 5e-8  # what no joint brings nearer keeps nothing for it
    assert steady.mean() < 0.2
    around = np.flatnonzero([bodies.is_around(pair) for pair in range(len(more))])
    for pair, extra in ((pair, more[pair]) for pair in [*around, *bodies.own_pairs]):
        names = bodies.names(pair)
        expected = strays[names[0]] if bodies.is_around(pair) else strays[" & ".join(names)]
        assert extra == pytest.approx(0.0 if steady[pair] else expected)
    wide = plan_with_arm(problem, strayed)
    assert wide.certified, wide.plan.reason
    path = wide.branch(np.linspace(0.0, 1.0, 101))
    for q in path:
        plain.place(q)
        for near in plain.near(0.03):
            asked = 0.01 if plain.is_around(near.pair) else setting.self_clearance
            assert near.gap >= asked + more[near.pair] - 1e-6


def test_wrong_covariance_risk_and_tube_are_named(planned):
    problem, setting, _ = planned
    with pytest.raises(InputError, match="covariance"):
        plan_links_at_risk(problem, setting, 0.05, mount_covariance=np.full((6, 6), np.nan))
    with pytest.raises(InputError, match="risk"):
        plan_links_at_risk(problem, setting, 0.0)
    few = Executions(problem, np.stack([problem.points] * 58), np.zeros((58, 0)))
    with pytest.raises(InputError, match=r"executions: 58 given; a risk of 0\.05 needs at least 59 of them"):
        plan_links_at_risk(problem, setting, 0.05, executions=few)
    tube = Tube(np.full(6, 0.01), {"no such link": 0.004}, 0.006, 1.0, 0.02, 0.01)
    with pytest.raises(InputError, match="tube: links"):
        replace(setting, tube=tube).bodies(problem.obstacles)


def test_the_risk_is_shared_between_the_cameras_demands_and_the_arms_gaps(planned):
    problem, setting, _ = planned
    random, views = np.random.default_rng(4), []
    for pose in (RigidTransform.identity(), problem.initial_T_goal):
        pixels, _ = problem.camera.project(pose.inv().apply(problem.points))
        views.append(pixels + 0.02 * random.standard_normal(pixels.shape))
    length = float(np.linalg.norm(problem.initial_T_goal.translation))
    estimate = estimate_two_view(problem.camera, *views, scale=length, noise=0.02)
    answer = plan_arm_with_risk(problem, setting, estimate, risk=0.2, mount_covariance=COVARIANCE)
    assert answer.plan.status == "certified", answer.plan.reason
    assert answer.links is not None
    assert answer.risk + answer.links.risk == pytest.approx(0.2)
