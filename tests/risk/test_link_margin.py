"""An uncertain camera mount and estimate: what they take from gaps is what sampled ones take."""

import sys
from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import RigidTransform, Rotation
from tests.whole_arm.arm_scenes import random_task

from omniservo.errors import InputError
from omniservo.estimation import estimate_two_view
from omniservo.risk import Executions, link_margin, plan_arm_with_risk, plan_links_at_risk
from omniservo.risk.gap_slopes import gap_slopes
from omniservo.risk.link_margin import Taken, _mounts, resting_moves, taken_by
from omniservo.risk.safe_path import allowed_violations
from omniservo.robots import Tube, load_arm
from omniservo.whole_arm import plan_with_arm
from omniservo.whole_arm.solids_of import solids_of

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
        close = [n for n in bodies.near(setting.clearance_around + 0.1) if bodies.is_around(n.pair)]
        pairs = [n.pair for n in close]
        np.testing.assert_allclose(slopes.left, [n.gap - setting.clearance for n in close], atol=1e-6)
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


def test_what_is_known_in_the_base_frame_stays_there_whatever_the_mount_is(planned):
    """The same bodies as obstacles and as surroundings have other slopes; both are those of differences."""
    problem, setting, found = planned
    around = solids_of(problem.obstacles, setting.base_T_initial)
    alone, standing = replace(problem, obstacles=()), replace(setting, surroundings=around)
    q, pose = found.branch(0.5), found.plan.path(0.5)
    bodies = standing.bodies(())
    slopes = gap_slopes(standing, bodies, pose, q)
    assert not np.allclose(
        slopes.by_mount, gap_slopes(setting, setting.bodies(problem.obstacles), pose, q)[1]
    )
    bodies.place(q)
    pairs = [n.pair for n in bodies.near(setting.clearance_around + 0.1) if bodies.is_around(n.pair)]
    assert pairs
    for pair, slope in zip(pairs, slopes.by_mount, strict=True):
        ends = [[gap_with(alone, standing, found, 0.5, xi, pair) for xi in (u, -u)] for u in 1e-6 * np.eye(6)]
        np.testing.assert_allclose(slope, np.diff(ends, axis=1)[:, 0] / -2e-6, atol=0.02)


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
    assert np.abs(taken.left[1:] - taken.left[0]).max() > 1e-3
    pose, most = found.plan.path(w), []
    bodies.place(found.branch(w))
    near = [n for n in bodies.near(setting.clearance_around + 0.1) if bodies.is_around(n.pair)]
    for share, estimated in zip(shares[1:], taken.estimate[1:], strict=True):
        other = pose.inv() * RigidTransform.from_components(share * pose.translation, pose.rotation)
        move = np.concatenate([other.translation, np.zeros(3)])
        rest = resting_moves(executions, found.plan.path, np.array([w]))[0, shares.index(share)]
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


def test_what_misses_anything_however_little_is_not_called_kept(planned, monkeypatch):
    problem, setting, _ = planned
    misses = Taken(np.where(np.arange(1000) < 60, -1e-5, 1.0), np.zeros(1000), np.zeros(1000))
    monkeypatch.setattr(link_margin, "taken_by", lambda *_: misses)
    found, margin = plan_links_at_risk(problem, setting, 0.05)
    assert found.plan.status == "not_found"
    assert "leave clear for the arm: 0.01 mm are missing" in found.plan.reason
    assert margin.violated == 0.06
    assert plan_links_at_risk(problem, setting, 0.09)[0].certified


@pytest.mark.parametrize("missing", [(), (0.004,), (0.003, 0.001)])
def test_clearance_grows_by_what_the_worst_sample_misses_that_may_not(planned, monkeypatch, missing):
    """Samples that miss 0, 0.1, 0.2, … mm less, of which as many may as keep the bound within the risk."""
    problem, setting, _ = planned
    most = allowed_violations(0.05, 1000)
    ladder = 1e-4 * (np.arange(1000.0) - most)
    samples = [Taken(ladder - short, np.zeros(1000), np.zeros(1000)) for short in (*missing, 0.0)]
    asked = []

    def planned_with(problem, setting, **options):
        asked.append(setting.clearance)
        return plan_with_arm(problem, setting, **options)

    monkeypatch.setattr(link_margin, "plan_with_arm", planned_with)
    monkeypatch.setattr(link_margin, "taken_by", lambda *_: samples[len(asked) - 1])
    found, margin = plan_links_at_risk(problem, setting, 0.05)
    added = link_margin.AHEAD * np.cumsum((0.0, *missing))
    assert asked == pytest.approx([setting.clearance + more for more in added])
    assert found.certified
    assert margin.added == pytest.approx(added[-1])
    assert found.clearance.clearance == pytest.approx(asked[-1])


def test_one_sample_more_than_allowed_is_not_called_kept(planned, monkeypatch):
    problem, setting, _ = planned
    most = allowed_violations(0.05, 1000)
    for violated, added in ((most, False), (most + 1, True)):
        misses = np.where(np.arange(1000) < violated, -1e-5, 1.0)
        monkeypatch.setattr(link_margin, "taken_by", lambda *_, m=misses: Taken(m, 0.0 * m, 0.0 * m))
        found, margin = plan_links_at_risk(problem, setting, 0.05)
        assert (margin.added > 0.0, found.certified) == (added, not added)


def test_what_links_stray_is_taken_from_gaps_before_mount_and_estimate_are(planned, monkeypatch):
    problem, setting, _ = planned
    parts = setting.bodies(problem.obstacles).tube_parts
    strayed = replace(
        setting, tube=Tube(np.full(6, 0.01), dict.fromkeys(parts, 0.005), 0.005, 1.0, 0.02, 0.01)
    )
    left = []

    def taken(given, bodies, *others):
        left.append(
            [taken_by(given, each, *others).left for each in (bodies, setting.bodies(problem.obstacles))]
        )
        return taken_by(given, bodies, *others)

    monkeypatch.setattr(link_margin, "taken_by", taken)
    assert plan_links_at_risk(problem, strayed, 0.05)[0].certified
    for with_tube, without in left:
        np.testing.assert_allclose(with_tube, without - 0.005, atol=1e-9)


def test_what_is_left_falls_by_the_slope_against_which_mount_and_camera_go(planned, monkeypatch):
    """Small errors, along and against the slopes of the gap that is nearest anywhere."""
    problem, setting, found = planned
    bodies, path, branch = setting.bodies(problem.obstacles), found.plan.path, found.branch
    at = [gap_slopes(setting, bodies, path(w), branch(w)) for w in np.linspace(0.0, 1.0, 33)]
    nearest = min((slopes for slopes in at if len(slopes.left)), key=lambda slopes: slopes.left.min())
    k = int(np.argmin(nearest.left))
    still = Executions(problem, np.stack([problem.points] * 2), np.zeros((2, 0)))
    for slopes in ((nearest.by_mount[k], np.zeros(6)), (np.zeros(6), nearest.by_move[k])):
        mounts, moves = (np.outer([-1e-6, 1e-6], slope) for slope in slopes)
        rests = [moves] * 33
        monkeypatch.setattr(link_margin, "resting_moves", lambda *_, rests=rests: rests)
        taken = taken_by(setting, bodies, path, branch, mounts, still)
        change = 1e-6 * np.square(slopes).sum()
        np.testing.assert_allclose(taken.left - nearest.left[k], [-change, change], atol=1e-3 * change)


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


def test_errors_of_a_mount_are_stated_in_the_flanges_frame_and_drawn_in_the_cameras(planned):
    """Along the flange's axis i alone, and about the camera's; the sizes are those of the covariance."""
    _, setting, _ = planned
    mount = RigidTransform.from_components([0.1, 0.2, 0.3], Rotation.from_rotvec([0.4, -0.9, 1.2]))
    oblique = replace(setting, flange_T_camera=mount, start=None)
    for i in range(6):
        drawn = _mounts(oblique, np.diag(4e-6 * np.eye(6)[i]), 4000, 3)
        seen = np.hstack([mount.rotation.apply(drawn[:, :3]), drawn[:, 3:]])
        assert np.abs(np.delete(seen, i, axis=1)).max() < 1e-9
        assert seen[:, i].std() == pytest.approx(2e-3, rel=0.05)


@pytest.mark.parametrize("off", [{"cx": 2.0}, {"cy": -2.0}])
def test_a_camera_that_is_off_rests_where_it_takes_the_points_for_the_planned_ones(planned, off):
    """What the true camera pictures, read with the stated one, is then what the plan sees."""
    problem, _, found = planned
    camera, pose = problem.camera, found.plan.path(0.5)
    true = replace(camera, **{name: getattr(camera, name) + error for name, error in off.items()})
    errors = np.array([[off.get(name, 0.0) for name in ("fx", "fy", "cx", "cy")]])
    executions = Executions(problem, problem.points[None], errors)

    def missed(move):
        seen = (pose * twisted(move)).inv().apply(problem.points)
        planned, _ = camera.unproject(camera.project(pose.inv().apply(problem.points))[0])
        return np.linalg.norm(camera.unproject(true.project(seen)[0])[0] - planned)

    assert missed(resting_moves(executions, found.plan.path, np.array([0.5]))[0, 0]) < 0.1 * missed(
        np.zeros(6)
    )


def test_wrong_covariance_risk_and_tube_are_named(planned):
    problem, setting, _ = planned
    with pytest.raises(InputError, match="covariance"):
        plan_links_at_risk(problem, setting, 0.05, mount_covariance=np.full((6, 6), np.nan))
    for none in (-COVARIANCE, COVARIANCE + 1e-7 * np.eye(6, k=1)):
        with pytest.raises(InputError, match="mount_covariance: a symmetric matrix"):
            plan_links_at_risk(problem, setting, 0.05, mount_covariance=none)
    with pytest.raises(InputError, match="risk"):
        plan_links_at_risk(problem, setting, 0.0)
    few = Executions(problem, np.stack([problem.points] * 93), np.zeros((93, 0)))
    with pytest.raises(InputError, match=r"executions: 93 given; a risk of 0\.05 needs at least 94 of them"):
        plan_links_at_risk(problem, setting, 0.05, draw=lambda: few)
    tube = Tube(np.full(6, 0.01), {"no such link": 0.004}, 0.006, 1.0, 0.02, 0.01)
    with pytest.raises(InputError, match="tube: links"):
        replace(setting, tube=tube).bodies(problem.obstacles)


@pytest.fixture(scope="module")
def estimate(planned):
    """From two images of the planned task, with little noise."""
    problem, _, _ = planned
    random, views = np.random.default_rng(4), []
    for pose in (RigidTransform.identity(), problem.initial_T_goal):
        pixels, _ = problem.camera.project(pose.inv().apply(problem.points))
        views.append(pixels + 0.02 * random.standard_normal(pixels.shape))
    length = float(np.linalg.norm(problem.initial_T_goal.translation))
    return estimate_two_view(problem.camera, *views, scale=length, noise=0.02)


def test_the_risk_is_shared_between_the_cameras_demands_and_the_arms_gaps(planned, estimate):
    problem, setting, _ = planned
    answer = plan_arm_with_risk(problem, setting, estimate, risk=0.2, mount_covariance=COVARIANCE)
    assert answer.plan.status == "certified", answer.plan.reason
    assert answer.links is not None
    assert answer.risk + answer.links.risk == pytest.approx(0.2)
    assert answer.links.violated <= answer.links.risk
    assert answer.links.mount > 1e-3
    assert answer.links.estimate > 1e-5


@pytest.mark.parametrize(("risk", "rows"), [(0.2, None), (0.008, [0, 1, 2, 4, 5, 7])])
def test_gaps_are_sampled_about_the_estimates_followed_points_often_enough(
    planned, estimate, monkeypatch, risk, rows
):
    """Whatever points and goal the problem has."""
    problem, setting, _ = planned
    given, sampled = [], sys.modules["omniservo.risk.plan_arm_with_risk"]

    def spied(asked, setting, share, **options):
        given.append((asked, share, options["draw"]()))
        return plan_links_at_risk(asked, setting, share, **options)

    monkeypatch.setattr(sampled, "plan_links_at_risk", spied)
    other = replace(problem, points=problem.points + 0.001)
    plan_arm_with_risk(other, setting, estimate, risk=risk, points=rows)
    followed = estimate.points[estimate.inliers if rows is None else rows]
    for asked, share, executions in given:
        assert share == pytest.approx(0.5 * risk)
        assert len(executions.points) == max(2000, np.ceil(20.0 / share)) // 4
        for stated in (asked, executions.problem):
            np.testing.assert_array_equal(stated.points, followed)
            assert stated.initial_T_goal is estimate.initial_T_goal
        np.testing.assert_allclose(executions.points.mean(axis=0), followed, atol=2e-3)
    assert given


def test_an_arm_that_need_keep_no_clearance_has_to_follow_all_the_same(planned, estimate):
    problem, setting, _ = planned
    alone = replace(setting, clearance=None)
    answer = plan_arm_with_risk(problem, alone, estimate, risk=0.2)
    assert (answer.ok, answer.risk, answer.links) == (True, 0.2, None)
    regular = plan_arm_with_risk(problem, replace(alone, singular_value=0.9), estimate, risk=0.2)
    assert not regular.ok
    assert "the arm is singular" in regular.plan.reason


@pytest.mark.parametrize(("begin", "asked"), [(0.003, [0.003]), (9.0, [9.0, 0.0])])
def test_it_begins_with_the_clearance_that_is_given_and_without_where_that_leaves_no_plan(
    planned, monkeypatch, begin, asked
):
    problem, setting, _ = planned
    given = []

    def planned_with(problem, setting, **options):
        given.append(setting.clearance)
        return plan_with_arm(problem, setting, **options)

    monkeypatch.setattr(link_margin, "plan_with_arm", planned_with)
    found, margin = plan_links_at_risk(problem, setting, 0.05, begin=begin)
    assert found.certified
    assert given == pytest.approx([setting.clearance + more for more in asked])
    assert margin.added == asked[-1]


@pytest.mark.parametrize("misses", [0, 1, 9])
def test_gaps_are_judged_by_samples_that_had_no_part_in_the_search(planned, estimate, monkeypatch, misses):
    """What those find too narrow is searched again with more samples for less risk, or is no plan."""
    problem, setting, _ = planned
    module, checked, drawn, begun = sys.modules["omniservo.risk.plan_arm_with_risk"], [], [], []

    def judged(found, setting, risk, covariance, executions, seed):
        margin, _ = link_margin.judged_links(found, setting, risk, covariance, executions, seed)
        checked.append((risk, executions, seed))
        return margin, 0.001 if len(checked) <= misses else 0.0

    def spied(asked, setting, share, **options):
        found, margin = plan_links_at_risk(asked, setting, share, **options)
        margin = replace(margin, added=margin.added + 0.001)
        drawn.append((share, len(options["draw"]().points)))
        begun.append((options["begin"], margin.added))
        return found, margin

    monkeypatch.setattr(module, "judged_links", judged)
    monkeypatch.setattr(module, "plan_links_at_risk", spied)
    answer = plan_arm_with_risk(problem, setting, estimate, risk=0.2, mount_covariance=COVARIANCE)
    assert answer.ok == (misses < 9)
    assert ("1.00 mm are missing" in answer.plan.reason) == (not answer.ok)
    assert answer.links.risk == pytest.approx(0.1)
    for risk, executions, seed in checked:
        assert (risk, len(executions.points), seed) == (pytest.approx(0.1), 2000, 1)
    assert drawn[0] == (pytest.approx(0.1), 500)
    if misses:
        assert drawn[-1][0] < 0.1
        assert drawn[-1][1] == 2000
    assert [first for first, _ in begun] == [0.0, *(last for _, last in begun[:-1])]
