"""Matches of another camera, of a tag taken for another: never a pose that is confident and wrong."""

import math

import numpy as np
import pytest
from benchmarks.hostile_pictures import KINDS, one_case, wrong_tag
from scipy.spatial.transform import Rotation

from omniservo.cameras import ModelError, UnifiedCamera
from omniservo.estimation import estimate_two_view
from omniservo.estimation.matches import Matches
from omniservo.estimation.refinement.epipolar_refinement import refine_epipolar
from omniservo.estimation.robust.two_view_fit import fit_two_views
from omniservo.estimation.robust.vouched_fit import leverages
from omniservo.estimation.status.camera_evidence import count_alike, focal_error
from omniservo.estimation.status.heavy_tails import tail_of

GIVEN = UnifiedCamera(150.0, 150.0, 159.5, 119.5, 1.0, 320, 240)
NOISE = 0.05


def longer_lens(factor):
    return UnifiedCamera(150.0 * factor, 150.0 * factor, 159.5, 119.5, 1.0, 320, 240)


PERSPECTIVE = UnifiedCamera(290.0, 290.0, 159.5, 119.5, 0.0, 320, 240)


def pixels_through(taken, rng, n=250):
    """Return what the camera that took the pictures sees of n points, before and after a motion."""
    turn = Rotation.from_rotvec(0.15 * rng.normal(size=3))
    shift = np.array([0.12, 0.03, -0.05])
    points = np.concatenate(  # of a wall and of two plates before it
        [
            rng.uniform([-w, -w, 0.0], [w, w, 0.0], (2 * n, 3)) @ Rotation.from_rotvec(tilt).as_matrix()
            + place
            for w, tilt, place in (
                (0.9, [0.1, 0.05, 0.0], [0.0, 0.0, 0.8]),
                (0.13, [0.3, -0.4, 0.0], [0.15, 0.1, 0.45]),
                (0.16, [-0.2, 0.4, 0.0], [-0.2, -0.05, 0.55]),
            )
        ]
    )
    points = rng.permutation(points)
    seen = [taken.project(p) for p in (points, turn.inv().apply(points - shift))]
    both = np.all([valid & taken.in_image(pixels) for pixels, valid in seen], axis=0)
    chosen = [pixels[both][:n] for pixels, _ in seen]
    return [pixels + NOISE * rng.normal(size=pixels.shape) for pixels in chosen]


def fitted(camera, initial, goal, noise=NOISE):
    matches = Matches.of_pixels(camera, np.hstack((initial, goal)), np.full((len(initial), 2), noise))
    fit = fit_two_views(matches, 0, True)
    return matches, fit, fit.minima[0]


@pytest.mark.parametrize(
    "taken", [longer_lens(1.2), longer_lens(1.5), PERSPECTIVE], ids=["20%", "50%", "flat"]
)
def test_matches_of_another_camera_are_refused(taken):
    rng = np.random.default_rng(31)
    for _ in range(6):
        found = estimate_two_view(GIVEN, *pixels_through(taken, rng), noise=NOISE)
        assert found.status == "not_converged", found.message


def test_a_lens_a_little_longer_is_named_with_how_much():
    found = estimate_two_view(GIVEN, *pixels_through(longer_lens(1.15), np.random.default_rng(5)))
    assert found.status == "not_converged"
    assert "focal length" in found.message
    assert "longer" in found.message


def test_the_right_camera_is_not_asked_for_another_focal_length():
    """φ/σ_φ is standard normal: no bias, though the distances' own noise is in their derivatives."""
    rng, ratios = np.random.default_rng(32), []
    for _ in range(80):
        initial, goal = pixels_through(GIVEN, rng, n=40)
        noisy = [p + 0.4 * rng.normal(size=p.shape) for p in (initial, goal)]
        matches, fit, best = fitted(GIVEN, *noisy, noise=0.4)
        members = matches.where(fit.members)
        focal, spread, cost = focal_error(members, best.rotation, best.translation)
        ratios.append(focal / (spread * math.sqrt(cost / (members.size - 6))))
    assert abs(np.mean(ratios)) < 0.35
    assert 0.75 < np.std(ratios) < 1.35


def test_the_focal_step_finds_the_lens_that_took_the_pictures():
    matches, fit, best = fitted(GIVEN, *pixels_through(longer_lens(1.05), np.random.default_rng(33)))
    focal, spread, _ = focal_error(matches.where(fit.members), best.rotation, best.translation)
    assert focal == pytest.approx(0.05, abs=max(5.0 * spread * NOISE, 0.005))
    assert 5.0 * spread * NOISE < 0.05


ROAD = UnifiedCamera(700.0, 700.0, 610.0, 185.0, 0.0, 1226, 370, model_error=ModelError(0.7, 123.0))
"""A perspective camera with the error that a file which states none is taken to have."""


def driven_ahead(rng, turn, shift, n=400):
    """Return pixels (n, 4) without noise of points beside a road, before and after the motion."""
    side = rng.choice([-1.0, 1.0], 8 * n) * rng.uniform(3.0, 12.0, 8 * n)
    points = np.stack([side, rng.uniform(-5.0, 1.6, 8 * n), rng.uniform(6.0, 40.0, 8 * n)], axis=-1)
    seen = [ROAD.project(p) for p in (points, turn.inv().apply(points - shift))]
    both = np.all([valid & ROAD.in_image(pixels) for pixels, valid in seen], axis=0)
    return np.hstack([pixels[both][:n] for pixels, _ in seen])


def looks_like_another_lens(pixels, fit, focal):
    """Return the smallest model error (n, 4) [px] that asks for f(1 + focal), and its size [σ]."""
    best, moves = fit.minima[0], ROAD.model_error.moves(pixels)
    answers = []
    for sign in (1e-3, -1e-3):
        moved = [Matches.of_pixels(ROAD, pixels + sign * move) for move in moves]
        answers.append([focal_error(m, best.rotation, best.translation)[0] for m in moved])
    slope = np.subtract(*answers) / 2e-3
    size = slope * focal / (slope @ slope)
    return np.einsum("f,fnk->nk", size, moves), float(np.linalg.norm(size))


def test_an_error_of_the_camera_itself_is_not_taken_for_another_focal_length():
    """Ahead, 0.9 σ of what the camera states asks for a focal length 25% shorter, and leaves few residuals.

    The few wrong matches are there so that the others are judged by the pixels' own noise.
    """
    rng = np.random.default_rng(4)
    turn, shift = Rotation.from_rotvec([0.0, 0.07, 0.0]), np.array([0.02, -0.02, 1.9])
    pixels = driven_ahead(rng, turn, shift)
    fit = fit_two_views(Matches.of_pixels(ROAD, pixels), 0, True)
    field, size = looks_like_another_lens(pixels, fit, -0.25)
    assert size < 1.0
    seen = pixels + field + 0.05 * rng.normal(size=pixels.shape)
    seen[:30, 2:] += rng.uniform(-6.0, 6.0, (30, 2))
    found = estimate_two_view(ROAD, seen[:, :2], seen[:, 2:], noise=0.05)
    assert found.status == "ok", found.message
    off = turn.inv() * found.initial_T_goal.rotation
    assert off.magnitude() < 3.0 * math.sqrt(np.trace(found.covariance[3:, 3:]))


def test_another_focal_length_is_named_where_the_camera_states_an_error_that_cannot_be_it():
    """In a wide lens 0.1 px leave the focal length open by a few per cent, not by 20."""
    stated = UnifiedCamera.from_dict({**GIVEN.to_dict(), "model_error": {"sigma_px": 0.1, "length_px": 64.0}})
    rng = np.random.default_rng(31)
    for _ in range(6):
        found = estimate_two_view(stated, *pixels_through(longer_lens(1.2), rng), noise=NOISE)
        assert found.status == "not_converged"
        assert "focal length" in found.message


def test_wrong_matches_at_random_are_not_alike_and_those_of_another_lens_are():
    rng = np.random.default_rng(34)
    initial, goal = pixels_through(GIVEN, rng)
    goal[:80] = rng.uniform([20, 20], [300, 220], (80, 2))
    for pixels, low, high in (
        ((initial, goal), 0.0, 0.6),
        (pixels_through(PERSPECTIVE, rng), 0.7, 1.0),
    ):
        matches, fit, best = fitted(GIVEN, *pixels)
        alike, rejected = count_alike(matches, fit.members, best.rotation, best.translation, 3.5 * NOISE)
        assert rejected > 50
        assert low <= alike / rejected <= high


def test_the_others_alone_put_a_match_where_its_leverage_says(make_scene):
    rng = np.random.default_rng(35)
    scene = make_scene(rng, n=12)
    initial, goal = scene.noisy(rng, 0.01)
    matches, _, best = fitted(scene.camera, initial, goal, noise=0.01)
    rotation, translation = best.rotation.copy(), best.translation.copy()
    refine_epipolar(matches.bearings, matches.jacobians, math.inf, rotation, translation, 50)
    distances, shares = np.empty(12), np.empty(12)
    assert leverages(matches, rotation, translation, distances, shares)
    assert shares.sum() == pytest.approx(5.0, abs=1e-6)
    for j in range(12):
        others = matches.where(np.arange(12) != j)
        r, t = rotation.copy(), translation.copy()
        refine_epipolar(others.bearings, others.jacobians, math.inf, r, t, 50)
        away, unused = np.empty(12), np.empty(12)
        assert leverages(matches, r, t, away, unused)
        assert away[j] == pytest.approx(distances[j] / (1.0 - shares[j]), rel=0.05, abs=2e-3)


@pytest.mark.parametrize("n", [20, 60])
def test_points_badly_found_count_as_noise_and_wrong_matches_do_not(make_scene, n):
    rng = np.random.default_rng(36)
    scene = make_scene(rng, n=n)
    initial, goal = scene.noisy(rng, 0.1)
    sums = []
    for offset in ([0.0, 0.0], [0.8, 0.7], [40.0, 35.0]):
        moved = goal.copy()
        moved[[3, 8, 14]] += offset
        matches, fit, _ = fitted(scene.camera, initial, moved, noise=0.1)
        sums.append(tail_of(matches, fit, 0.1))
    assert sums[0] == (0.0, 0)
    assert sums[1][1] >= 2
    assert 0.3**2 < sums[1][0] / sums[1][1] < 1.1**2  # a point moved across its epipolar line, or nearly
    assert sums[2] == (0.0, 0)


@pytest.mark.parametrize("n", [30, 100])
def test_many_points_badly_found_are_no_pose_and_as_many_wrong_matches_are_one(make_scene, n):
    rng = np.random.default_rng(37)
    scene = make_scene(rng, n=n)
    initial, goal = scene.noisy(rng, 0.1)
    said = []
    for spread, bad in ((0.0, 0), (1.0, 6 * n // 10), (60.0, n // 3)):
        moved = goal.copy()
        moved[:bad] += spread * rng.standard_normal((bad, 2))
        said.append(estimate_two_view(scene.camera, initial, moved, noise=0.1))
    assert [estimate.status for estimate in said] == ["ok", "not_converged", "ok"]
    assert "badly found" in said[1].message
    assert said[2].inliers[: n // 3].sum() <= 1  # moved along its epipolar line


def test_points_behind_a_camera_are_rejected_and_not_taken_for_badly_found():
    answers = [one_case(("points behind", seed))[2] for seed in range(3000, 3020)]
    assert not any(wrong for _, wrong in answers)
    assert sum(words == "ok, right" for words, _ in answers) >= 8
    assert sum(words == "not_converged" for words, _ in answers) <= 3


@pytest.mark.parametrize("seed", [3173, 30324])
def test_another_camera_that_nearly_all_matches_agree_with_is_told_by_its_focal_length(seed):
    assert one_case(("another camera", seed))[2] == ("not_converged", False)


@pytest.mark.parametrize("seed", [12284, 20095, 20253])
def test_another_camera_that_four_in_five_matches_agree_with_is_told_by_those_rejected(seed):
    """5 to 11% of the matches are rejected, far off and alike side by side: 20 of 25, say."""
    status, is_wrong = one_case(("another camera", seed))[2]
    assert status in ("not_converged", "ambiguous")  # the second, of one of them, with OpenCV 5's features
    assert not is_wrong


def test_more_than_forty_matches_of_blurred_pictures_count_the_badly_found_as_noise():
    """Nearly a plane: with the members' noise alone its second motion would be the only one."""
    words, wrong = one_case(("motion blur", 6425))[2]
    assert words.startswith("ok, far within"), words
    assert not wrong


def wrong_corners(seed):
    """The answer to tags of which one is taken for another, not told that they are square."""
    rng = np.random.default_rng([sorted(KINDS).index("one wrong tag number"), seed])
    return wrong_tag(rng, tags_are_square=False)


def test_two_groups_that_may_be_wrong_are_named_where_they_give_two_motions():
    status, wrong = wrong_corners(3232)  # corner 14, or the four of the last tag
    assert (status, wrong) == ("ambiguous", False)


def test_one_tag_taken_for_another_is_never_confident_and_wrong():
    """The scenes in which a corner of the wrong tag was let in, because the motion bent to it, and others."""
    for seed in (6, 38, 50, 60, 87, 92, 101, 218, 220, 346, 387, 406, 886, 1007, 2363, *range(20)):
        words, wrong = wrong_corners(seed)
        assert not wrong, (seed, words)
