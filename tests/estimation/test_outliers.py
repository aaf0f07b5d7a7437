"""Wrong matches: found, and never taken for parallax."""

import math
import tracemalloc

import numpy as np
import pytest
from benchmarks.comparisons.motion import random_pair
from scipy.spatial.transform import Rotation

from omniservo.cameras import preset
from omniservo.estimation import estimate_two_view
from omniservo.estimation.matches import Matches
from omniservo.estimation.robust.map_consensus import bulk_maps
from omniservo.estimation.robust.vouched_fit import odds_beside
from omniservo.estimation.status.degenerate_motion import HOMOGRAPHY, IDENTITY, ROTATION
from omniservo.estimation.status.evidence import _bent_to, _in_band

TURN = Rotation.from_rotvec([0.1, -0.3, 0.2])
SHIFT = np.array([0.15, -0.05, 0.1])


def spoilt(scene, rng, sigma, share):
    """Both images with noise, and a share of the goal's pixels anywhere in the image."""
    initial, goal = scene.noisy(rng, sigma)
    wrong = rng.permutation(len(goal)) < share * len(goal)
    size = (0.15 * scene.camera.width, 0.15 * scene.camera.height)
    far = (0.85 * scene.camera.width, 0.85 * scene.camera.height)
    goal[wrong] = rng.uniform(size, far, (wrong.sum(), 2))
    return initial, goal, wrong


@pytest.mark.parametrize("share", [0.3, 0.5])
def test_a_third_and_a_half_of_a_hundred_wrong_matches_are_found(make_scene, camera, share):
    rng = np.random.default_rng(91)
    good = 0
    for _ in range(15):
        scene = make_scene(rng, n=100, camera=camera, turn=0.2)
        initial, goal, wrong = spoilt(scene, rng, 0.2, share)
        estimate = estimate_two_view(camera, initial, goal)
        if estimate.status != "ok":
            continue
        turn = (estimate.initial_T_goal.rotation.inv() * scene.rotation).magnitude()
        sigma = math.sqrt(estimate.covariance[3:, 3:].trace())
        good += turn < 5 * sigma and (estimate.inliers & ~wrong).sum() > 0.9 * (~wrong).sum()
    assert good >= 14


@pytest.mark.parametrize("share", [0.05, 0.3])
@pytest.mark.parametrize("kind", ["planar_points", "pure_rotation", "no_motion"])
@pytest.mark.parametrize("n", [20, 100])
def test_what_is_no_pose_stays_none_among_wrong_matches(fisheye, make_view, make_scene, kind, n, share):
    rng = np.random.default_rng(92)
    statuses = []
    for _ in range(12):
        points = make_scene(rng, n=n, turn=0.1).points
        if kind == "planar_points":
            flat = np.column_stack((0.12 * rng.uniform(-1, 1, (n, 2)), np.zeros(n)))
            points = Rotation.from_rotvec([0.4, 0.2, 0.0]).apply(flat) + np.array([0, 0, 0.5])
        turn = Rotation.identity() if kind == "no_motion" else TURN
        scene = make_view(fisheye, points, turn, SHIFT if kind == "planar_points" else np.zeros(3))
        initial, goal, _ = spoilt(scene, rng, 0.2, share)
        statuses.append(estimate_two_view(fisheye, initial, goal).status)
    assert "ok" not in statuses
    assert statuses.count(kind) >= 10


def test_half_of_two_thousand_matches_are_wrong(fisheye, make_view):
    rng = np.random.default_rng(2000)
    points = rng.uniform([-0.25, -0.2, 0.4], [0.25, 0.2, 0.8], (2000, 3))
    scene = make_view(fisheye, points, TURN, SHIFT)
    initial, goal = scene.noisy(rng, 0.3)
    goal[:1000] = goal[:1000][rng.permutation(1000)]
    found = estimate_two_view(fisheye, initial, goal, noise=0.3)
    assert found.status == "ok", found.message
    assert 950 < found.inliers.sum() < 1100
    turn = (scene.initial_T_goal.rotation.inv() * found.initial_T_goal.rotation).magnitude()
    assert math.degrees(turn) < 0.3


@pytest.mark.parametrize("share", [0.001, 0.3])
def test_wrong_ones_among_ten_thousand_matches_take_no_forty_megabytes(fisheye, make_view, share):
    """It was 133 and 58; of 100 000 matches gigabytes, and minutes."""
    rng = np.random.default_rng(1)
    points = rng.uniform([-0.25, -0.2, 0.4], [0.25, 0.2, 0.8], (10_000, 3))
    scene = make_view(fisheye, points, TURN, SHIFT)
    initial, goal, wrong = spoilt(scene, rng, 0.3, share)
    estimate_two_view(fisheye, initial[:200], goal[:200], noise=0.3)  # loads what is compiled
    tracemalloc.start()
    found = estimate_two_view(fisheye, initial, goal, noise=0.3)
    _, most = tracemalloc.get_traced_memory()
    tracemalloc.stop()
    assert found.status == "ok", found.message
    assert 0.99 < found.inliers.sum() / (~wrong).sum() < 1.05
    assert most < 4e7


def test_a_scene_with_a_wall_behind_its_target_is_a_pose(fisheye, make_view):
    """Two thirds of the matches on one plane, a few wrong: parallax of the others is real."""
    rng = np.random.default_rng(93)
    good = 0
    for _ in range(10):
        flat = np.column_stack((0.2 * rng.uniform(-1, 1, (60, 2)), np.zeros(60)))
        flat[:20, 2] = rng.uniform(-0.2, -0.05, 20)
        scene = make_view(fisheye, flat + np.array([0, 0, 0.6]), TURN, SHIFT)
        initial, goal, _ = spoilt(scene, rng, 0.2, 0.1)
        estimate = estimate_two_view(fisheye, initial, goal)
        if estimate.status == "ok":
            good += (estimate.initial_T_goal.rotation.inv() * TURN).magnitude() < math.radians(2.0)
    assert good >= 9


@pytest.mark.parametrize("n", [5, 6, 7])
def test_fewer_than_eight_sharp_matches_give_the_pose_or_a_named_status(make_scene, n):
    rng = np.random.default_rng(94)
    counts = {"ok": 0}
    for _ in range(25):
        scene = make_scene(rng, n=n)
        estimate = estimate_two_view(scene.camera, *scene.noisy(rng, 0.01), noise=0.01)
        counts[estimate.status] = counts.get(estimate.status, 0) + 1
        if estimate.status == "ok":
            turn = (estimate.initial_T_goal.rotation.inv() * scene.rotation).magnitude()
            assert turn < max(5 * math.sqrt(estimate.covariance[3:, 3:].trace()), 0.01)
    assert set(counts) <= {"ok", "ambiguous", "planar_points", "not_converged", "pure_rotation"}
    assert counts["ok"] >= {5: 3, 6: 12, 7: 18}[n]


def test_five_matches_of_unknown_noise_are_hardly_ever_answered(make_scene):
    rng = np.random.default_rng(95)
    statuses = []
    for _ in range(20):
        scene = make_scene(rng, n=5)
        statuses.append(estimate_two_view(scene.camera, *scene.noisy(rng, 0.3)).status)
    assert statuses.count("ok") <= 6


def test_a_false_minimum_does_not_win_by_the_members_that_it_chose():
    """Scenes over 90 px with 30% wrong matches near the target: the second motion holds nearly as many."""
    rng, errors = np.random.default_rng([100, 3]), []
    for _ in range(10):
        pair = random_pair(rng, preset("para-catadioptric"), 100, 0.3)
        found = estimate_two_view(pair.camera, pair.initial, pair.goal).initial_T_goal
        if found is not None:
            errors.append((found.rotation.inv() * pair.initial_T_goal.rotation).magnitude())
    assert len(errors) >= 9
    assert max(errors) < np.radians(5.0)


@pytest.mark.parametrize("k", [1, 2])
@pytest.mark.parametrize("noise", [None, 0.05])
def test_wrong_matches_do_not_choose_between_the_two_motions_of_a_plane(fisheye, make_view, k, noise):
    """They lie where points off the plane would be, had the camera moved by the plane's other motion."""
    rng = np.random.default_rng(94)
    flat = np.column_stack((0.1 * rng.uniform(-1, 1, (200, 2)), np.zeros(200)))
    points = Rotation.from_rotvec([0.5, 0.3, 0.0]).apply(flat) + np.array([0, 0, 0.6])
    scene = make_view(fisheye, points, TURN, SHIFT)
    initial, goal = scene.noisy(rng, 0.05)
    both = estimate_two_view(fisheye, initial, goal, method="homography").alternatives
    wrong = max(both, key=lambda pose: (pose.rotation.inv() * TURN).magnitude())
    bent = wrong.inv()  # whose plane is another one: found from the matches' rays
    rays = [fisheye.unproject(p[:k])[0] for p in (initial, goal)]
    for j in range(k):
        sides = np.column_stack((bent.rotation.apply(rays[0][j]), -rays[1][j]))
        depth = np.linalg.lstsq(sides, -bent.translation, rcond=None)[0][0]
        goal[j] = fisheye.project(bent.apply((1.1 + 0.1 * j) * depth * rays[0][j]))[0]
    assert np.linalg.norm(goal[:k] - scene.pixels_goal[:k], axis=1).min() > 1.0
    found = estimate_two_view(fisheye, initial, goal, noise=noise)
    assert found.status == "planar_points", found.message


def test_a_few_points_off_a_plane_are_parallax(fisheye, make_view):
    """Three of 23 that agree with one motion, far from the plane: wrong ones lie in any direction."""
    rng = np.random.default_rng(95)
    right = 0
    for _ in range(10):
        flat = np.column_stack((0.15 * rng.uniform(-1, 1, (23, 2)), np.zeros(23)))
        flat[:3, 2] = -0.15
        scene = make_view(fisheye, flat + np.array([0, 0, 0.6]), TURN, SHIFT)
        found = estimate_two_view(fisheye, *scene.noisy(rng, 0.03))
        if found.status == "ok":
            right += (found.initial_T_goal.rotation.inv() * TURN).magnitude() < math.radians(0.5)
    assert right >= 9


def test_three_matches_moved_along_one_line_are_no_parallax_of_a_camera_that_only_turned(fisheye, make_view):
    """To either side; the motion bends to two of them, the third agrees in one of two cases."""
    rng, found = np.random.default_rng(97), []
    for _ in range(20):
        points = np.column_stack((rng.uniform(-0.4, 0.4, (30, 2)), np.ones(30)))
        initial, goal = make_view(fisheye, points, TURN, np.zeros(3)).noisy(rng, 0.2)
        goal[:3, 0] += 20.0 * rng.choice([-1.0, 1.0], 3)
        found.append(estimate_two_view(fisheye, initial, goal).status)
    assert found.count("pure_rotation") == 20, found


@pytest.mark.parametrize(("off", "counts"), [(12, True), (16, False)])
def test_a_plane_counts_where_most_of_the_members_obey_it(fisheye, make_view, off, counts):
    """28 or 24 of 40; 65% are asked for."""
    flat = np.column_stack((0.15 * np.random.default_rng(96).uniform(-1, 1, (40, 2)), np.zeros(40)))
    flat[:off, 2] = -np.linspace(0.1, 0.3, off)
    scene = make_view(fisheye, flat + np.array([0, 0, 0.6]), TURN, SHIFT)
    matches = Matches.of_pixels(fisheye, np.hstack((scene.pixels_initial, scene.pixels_goal)))
    apart = bulk_maps(matches, np.ones(40, dtype=bool), 0.5)[HOMOGRAPHY]
    assert (apart < 0.5).tolist() == [counts and j >= off for j in range(40)]
    assert np.isinf(apart).all() != counts


@pytest.mark.parametrize(("still", "counts"), [(28, True), (24, False)])
def test_no_motion_counts_where_most_of_the_members_obey_it(fisheye, make_view, still, counts):
    """A turn about the axis, which all obey: the nearer to the axis, the less it moves them."""
    slope = np.where(np.arange(40) < still, 0.01, 0.4)
    around = np.linspace(0.0, 20.0, 40)
    points = np.column_stack((slope * np.cos(around), slope * np.sin(around), np.ones(40)))
    scene = make_view(fisheye, points, Rotation.from_rotvec([0.0, 0.0, 0.02]), np.zeros(3))
    matches = Matches.of_pixels(fisheye, np.hstack((scene.pixels_initial, scene.pixels_goal)))
    found = bulk_maps(matches, np.ones(40, dtype=bool), 0.5)
    assert (found[ROTATION] < 0.5).all()
    assert (found[IDENTITY] < 0.5).tolist() == [counts and j < still for j in range(40)]
    assert np.isinf(found[IDENTITY]).all() != counts


def test_the_chance_that_wrong_matches_agree_is_no_less_than_the_exact_one():
    """Exact: every match's own chance, convolved. Where all are as far it is that."""
    for apart, k in ((np.array([3.0, 5.0, 8.0, 20.0, 90.0]), 5), (np.full(6, 12.0), 4), (np.full(9, 4.0), 8)):
        chances = 2.0 / np.pi * np.arcsin(1.0 / apart)
        law = np.ones(1)
        for p in chances:
            law = np.convolve(law, [1.0 - p, p])
        exact = math.comb(len(apart) + 2, 2) * law[k - 2 :].sum()
        found = _bent_to(k, len(apart) + 2, _in_band(apart, 1.0))
        assert found >= exact * (1.0 - 1e-12)
        if np.ptp(apart) == 0.0:
            assert found == pytest.approx(exact)
    assert _bent_to(2, 3, _in_band(np.full(1, 100.0), 1.0)) == 1.0


def test_the_odds_of_matches_are_those_of_their_nearest_also_of_ten_thousand_and_of_the_same_ones():
    """All distances of ten thousand matches at once took 5 GB."""
    rng = np.random.default_rng(5)
    few = rng.uniform(0.0, 600.0, (40, 4))
    inside = rng.random(40) < 0.7
    worst = np.zeros(40)
    for image in (few[:, :2], few[:, 2:]):
        apart = np.linalg.norm(image[:, None] - image, axis=2) + np.diag(np.full(40, np.inf))
        worst = np.maximum(worst, (~inside)[np.argsort(apart, axis=1)[:, :3]].sum(axis=1))
    expected = np.maximum((worst + 0.5) / (3.5 - worst), (~inside).sum() / inside.sum())
    camera = preset("perspective")
    np.testing.assert_allclose(odds_beside(Matches.of_pixels(camera, few), inside), expected)
    many = np.repeat(rng.uniform(100.0, 400.0, (2000, 4)), 5, axis=0)
    odds = odds_beside(Matches.of_pixels(camera, many), rng.random(len(many)) < 0.7)
    assert ((odds > 0.0) & (odds <= 7.0)).all()
