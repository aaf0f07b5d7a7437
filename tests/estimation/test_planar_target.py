"""Motion before a plane: method="homography"."""

import math

import numpy as np
import pytest
from scipy.optimize import least_squares
from scipy.spatial.transform import Rotation
from scipy.stats import f

from omniservo.estimation import estimate_two_view
from omniservo.estimation.matches import Matches
from omniservo.estimation.refinement.planar_motion import (
    decompose_homography,
    planar_blocks,
    refine_planar_motion,
)
from omniservo.estimation.status.degenerate_motion import HOMOGRAPHY, algebraic_map


def board(rng, n, tilt, relief=0.0):
    flat = np.column_stack((0.12 * rng.uniform(-1, 1, (n, 2)), relief * rng.uniform(-1, 1, n)))
    return Rotation.from_rotvec(tilt).apply(flat) + np.array([0, 0, 0.5])


def unique_scene(make_view, camera, rng, n=12):
    """A board seen with one possible motion only."""
    while True:
        turn = Rotation.from_rotvec(0.2 * rng.normal(size=3))
        direction = rng.normal(size=3)
        try:
            scene = make_view(
                camera,
                board(rng, n, 0.5 * rng.normal(size=3)),
                turn,
                0.2 * direction / np.linalg.norm(direction),
            )
        except AssertionError:
            continue
        if len(candidates(scene)) == 1:
            return scene


def candidates(scene):
    pixels = np.hstack([scene.pixels_initial, scene.pixels_goal])
    matches = Matches.of_pixels(scene.camera, pixels)
    everyone = np.ones(len(pixels), dtype=bool)
    matrix = algebraic_map(matches.bearings, everyone, HOMOGRAPHY)
    return decompose_homography(matrix, matches.bearings[:, 3:])


def test_every_decomposition_explains_the_board_and_one_is_the_truth(camera, make_view):
    rng = np.random.default_rng(101)
    counts = []
    for _ in range(40):
        try:
            scene = make_view(
                camera,
                board(rng, 8, 0.4 * rng.normal(size=3)),
                Rotation.from_rotvec(0.15 * rng.normal(size=3)),
                0.15 * rng.uniform(-1, 1, 3),
            )
        except AssertionError:
            continue
        found = candidates(scene)
        counts.append(len(found))
        assert min(np.abs(m.rotation - scene.rotation.as_matrix()).max() for m in found) < 1e-7
        rays = camera.unproject(scene.pixels_goal)[0]
        for motion in found:
            points = motion.points(rays)
            seen, valid = camera.project(points)
            assert valid.all()
            np.testing.assert_allclose(seen, scene.pixels_initial, atol=1e-6)
            np.testing.assert_allclose(np.linalg.det(motion.rotation), 1.0, atol=1e-9)
    assert set(counts) == {1, 2}


@pytest.mark.parametrize("n", [4, 5, 12, 60])
def test_exact_pixels_of_a_board_give_the_exact_answer_where_it_is_unique(fisheye, make_view, n):
    rng = np.random.default_rng(102)
    scene = unique_scene(make_view, fisheye, rng, n)
    length = float(np.linalg.norm(scene.translation))
    estimate = estimate_two_view(
        fisheye, scene.pixels_initial, scene.pixels_goal, method="homography", scale=length, noise=0.01
    )
    assert estimate.status == "ok", estimate.message
    np.testing.assert_allclose(estimate.initial_T_goal.translation, scene.translation, atol=1e-7)
    np.testing.assert_allclose(
        estimate.initial_T_goal.rotation.as_matrix(), scene.rotation.as_matrix(), atol=1e-7
    )
    np.testing.assert_allclose(estimate.points, scene.points, atol=1e-7)


def test_two_motions_that_see_the_board_alike_are_both_named(fisheye, make_view):
    rng = np.random.default_rng(103)
    while True:
        scene = make_view(
            fisheye, board(rng, 12, 0.4 * rng.normal(size=3)), Rotation.identity(), np.array([0.3, 0.05, 0.0])
        )
        both = candidates(scene)
        if len(both) == 2:
            break
    estimate = estimate_two_view(fisheye, scene.pixels_initial, scene.pixels_goal, method="homography")
    assert estimate.status == "ambiguous"
    assert estimate.initial_T_goal is None
    for motion in both:
        assert f"({motion.translation[0]:.3f}," in estimate.message
        nearest = min(estimate.alternatives, key=lambda p: np.linalg.norm(p.translation - motion.translation))
        np.testing.assert_allclose(nearest.translation, motion.translation, atol=1e-9)
        np.testing.assert_allclose(nearest.rotation.as_matrix(), motion.rotation, atol=1e-9)


def test_the_refinement_is_the_minimum_that_scipy_finds(fisheye, make_view):
    rng = np.random.default_rng(104)
    scene = unique_scene(make_view, fisheye, rng, 10)
    initial, goal = scene.noisy(rng, 0.3)
    matches = Matches.of_pixels(fisheye, np.hstack([initial, goal]))
    (start,) = candidates(scene)
    motion, _, blocks = refine_planar_motion(matches, start)
    rays = fisheye.unproject(goal)[0]

    def residuals(x):
        rotation = Rotation.from_matrix(start.rotation) * Rotation.from_rotvec(x[:3])
        t, normal = start.translation + x[3:6], start.normal + x[6:9]
        t, normal = t / np.linalg.norm(t), normal * np.linalg.norm(t)
        goal_points = rays + x[9:].reshape(-1, 3)
        goal_points = goal_points / (goal_points @ normal)[:, None]
        points = rotation.apply(goal_points) + t
        rest = (fisheye.project(points)[0] - initial, fisheye.project(goal_points)[0] - goal)
        return np.concatenate(
            (np.concatenate(rest).ravel(), 1e3 * np.sum(x[9:].reshape(-1, 3) * rays, axis=1))
        )

    reference = least_squares(residuals, np.zeros(9 + 30), xtol=1e-15, ftol=1e-15, gtol=1e-14, x_scale="jac")
    assert blocks.cost == pytest.approx(2.0 * reference.cost, rel=1e-4)
    turn = (start.rotation @ Rotation.from_rotvec(reference.x[:3]).as_matrix()).T @ motion.rotation
    assert Rotation.from_matrix(turn).magnitude() < 1e-3


def test_planar_derivatives_agree_with_finite_differences(camera, make_view):
    rng = np.random.default_rng(105)
    scene = unique_scene(make_view, camera, rng, 6)
    initial, goal = scene.noisy(rng, 0.5)
    matches = Matches.of_pixels(camera, np.hstack([initial, goal]), rng.uniform(0.2, 1.0, (6, 2)))
    (motion,) = candidates(scene)
    rays = matches.bearings[:, 3:].copy()
    here = planar_blocks(matches, motion, rays)

    def moved(step, turns):
        rotation = motion.rotation @ Rotation.from_rotvec(step[:3]).as_matrix()
        other = motion._replace(
            rotation=rotation,
            translation=motion.translation + here.across @ step[3:5],
            normal=motion.normal + step[5:],
        )
        return planar_blocks(matches, other, rays + (here.tangents @ turns)).residuals

    for i, s in enumerate(1e-6 * np.eye(8)):
        slope = (moved(s, np.zeros(2)) - moved(-s, np.zeros(2))) / 2e-6
        np.testing.assert_allclose(here.to_motion[:, :, i], slope, rtol=1e-5, atol=1e-3)
    for i, s in enumerate(1e-6 * np.eye(2)):
        slope = (moved(np.zeros(8), s) - moved(np.zeros(8), -s)) / 2e-6
        np.testing.assert_allclose(here.to_ray[:, :, i], slope, rtol=1e-5, atol=1e-3)


@pytest.mark.slow
@pytest.mark.parametrize("scale", [None, ((0, 7), None)])
def test_covariance_before_a_board_is_that_of_repeated_noise_or_a_little_larger(fisheye, make_view, scale):
    """The law is stretched to the tips of 5 σ: at most by a half in σ."""
    rng = np.random.default_rng(106)
    scene = unique_scene(make_view, fisheye, rng, 20)
    unit = float(np.linalg.norm(scene.translation))
    if scale is not None:
        scale, unit = ((0, 7), float(np.linalg.norm(scene.points[0] - scene.points[7]))), 1.0
    inside, trials, errors, predicted = 0, 120, [], []
    for _ in range(trials):
        estimate = estimate_two_view(
            fisheye, *scene.noisy(rng, 0.03), method="homography", scale=scale, robust=False
        )
        assert estimate.status == "ok", estimate.message
        pose = estimate.initial_T_goal
        turn = (scene.rotation.inv() * pose.rotation).as_rotvec()
        deviation = np.concatenate((pose.translation - scene.translation / unit, turn))
        square = turn @ np.linalg.solve(estimate.covariance[3:, 3:], turn)
        inside += square * 32 / 30 < 3 * f.ppf(0.95, 3, 32)
        errors.append(np.concatenate((deviation, (estimate.points[:3] - scene.points[:3] / unit).ravel())))
        each = [np.diag(c) for c in estimate.points_covariance[:3]]
        predicted.append(np.concatenate((np.diag(estimate.covariance), *each)))
    assert 0.91 <= inside / trials <= 0.99
    ratio = np.std(errors, axis=0) / np.sqrt(np.mean(predicted, axis=0) * 30 / 32)
    assert (ratio < 1.2).all()
    assert (ratio > 0.66).all()


def test_wrong_matches_on_a_board_are_found(fisheye, make_view):
    rng = np.random.default_rng(107)
    good = 0
    for _ in range(8):
        scene = unique_scene(make_view, fisheye, rng, 60)
        initial, goal = scene.noisy(rng, 0.1)
        goal[:18] = rng.uniform([100, 60], [550, 380], (18, 2))
        estimate = estimate_two_view(fisheye, initial, goal, method="homography")
        if estimate.status == "ok":
            turn = (estimate.initial_T_goal.rotation.inv() * scene.rotation).magnitude()
            sigma = math.sqrt(estimate.covariance[3:, 3:].trace())
            good += (
                turn < 4 * sigma and estimate.inliers[:18].sum() <= 1 and estimate.inliers[18:].sum() >= 38
            )
    assert good >= 7


def test_points_off_the_plane_rotation_and_no_motion_are_named(fisheye, make_view, make_scene):
    rng = np.random.default_rng(108)
    turn, shift = Rotation.from_rotvec([0.1, -0.3, 0.2]), np.array([0.15, -0.05, 0.1])
    scenes = {
        "on one plane": make_view(fisheye, board(rng, 20, [0.4, 0.2, 0.0], 0.05), turn, shift),
        "rotation": make_view(fisheye, board(rng, 20, [0.4, 0.2, 0.0]), turn, np.zeros(3)),
        "same": make_view(fisheye, board(rng, 20, [0.4, 0.2, 0.0]), Rotation.identity(), np.zeros(3)),
    }
    expected = {"on one plane": "not_converged", "rotation": "pure_rotation", "same": "no_motion"}
    for words, scene in scenes.items():
        for sigma in (0.0, 0.1):
            estimate = estimate_two_view(fisheye, *scene.noisy(rng, sigma), method="homography")
            assert estimate.status == expected[words], (words, sigma, estimate.message)
            assert words in estimate.message


def test_three_points_are_too_few_and_the_eight_point_method_refuses_the_board(fisheye, make_view):
    rng = np.random.default_rng(109)
    scene = unique_scene(make_view, fisheye, rng, 12)
    few = estimate_two_view(fisheye, scene.pixels_initial[:3], scene.pixels_goal[:3], method="homography")
    assert few.status == "too_few_points"
    assert estimate_two_view(fisheye, *scene.noisy(rng, 0.1)).status == "planar_points"


def two_boards(make_view, camera, rng, off):
    """A board that is seen with one possible motion, and the same one moved by ``off`` in its own frame."""
    while True:
        turn, tilt = Rotation.from_rotvec(0.2 * rng.normal(size=3)), 0.5 * rng.normal(size=3)
        shift = 0.2 * rng.normal(size=3) / 1.7
        points = board(rng, 70, tilt)
        there = points + Rotation.from_rotvec(tilt).apply(off)
        try:
            here, other = (make_view(camera, p, turn, shift) for p in (points, there))
        except AssertionError:
            continue
        if len(candidates(here)) == 1:
            return here, other


def test_a_pattern_of_which_a_part_is_matched_one_period_off_is_no_sure_plane(fisheye, make_view):
    """The larger part was the answer, whichever it was: before a wallpaper 45° off, and sure to 0.4°."""
    rng, named = np.random.default_rng(110), 0
    for wrong in 6 * (44, 26):
        here, other = two_boards(make_view, fisheye, rng, np.array([0.05, 0.04, 0.0]))
        initial, goal = here.noisy(rng, 0.1)
        goal[:wrong] = other.noisy(rng, 0.1)[1][:wrong]
        found = estimate_two_view(fisheye, initial, goal, method="homography", noise=0.1)
        named += found.status == "ambiguous" and "others with another: a pattern repeats" in found.message
    assert named >= 9  # a period along the epipolar lines is a plane of another depth


def test_a_small_thing_that_moves_before_a_plane_is_no_doubt(fisheye, make_view):
    rng = np.random.default_rng(114)
    for _ in range(6):
        here, other = two_boards(make_view, fisheye, rng, np.array([0.05, 0.04, 0.0]))
        initial, goal = here.noisy(rng, 0.1)
        goal[:9] = other.noisy(rng, 0.1)[1][:9]
        found = estimate_two_view(fisheye, initial, goal, method="homography", noise=0.1)
        assert "others with another" not in found.message


def test_a_second_plane_of_the_same_scene_does_not_make_the_first_one_doubtful(fisheye, make_view):
    rng, answered = np.random.default_rng(111), 0
    for _ in range(10):
        here, other = two_boards(make_view, fisheye, rng, np.array([0.0, 0.0, 0.08]))
        (initial, goal), behind = here.noisy(rng, 0.1), other.noisy(rng, 0.1)
        initial[:26], goal[:26] = behind[0][:26], behind[1][:26]
        found = estimate_two_view(fisheye, initial, goal, method="homography", noise=0.1)
        answered += found.status == "ok"
        assert "others with another" not in found.message
    assert answered > 5  # of others a plane leaves two motions


@pytest.mark.parametrize(
    ("wrong", "low", "high", "noise"),
    [(26, (100, 60), (550, 380), 0.1), (32, (150, 90), (220, 160), 0.5)],
    ids=["anywhere", "in a small part of the image"],
)
def test_wrong_matches_beside_a_board_are_no_second_plane(fisheye, make_view, wrong, low, high, noise):
    rng = np.random.default_rng(113)
    for _ in range(10):
        here, _ = two_boards(make_view, fisheye, rng, np.zeros(3))
        initial, goal = here.noisy(rng, noise)
        goal[:wrong] = rng.uniform(low, high, (wrong, 2))
        found = estimate_two_view(fisheye, initial, goal, method="homography", noise=2.0 * noise)
        assert "others with another" not in found.message
