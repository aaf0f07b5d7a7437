"""Views that an arm has reached: goal and points, with the arm's displacements as scale and prior."""

from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from scipy.spatial.transform import RigidTransform, Rotation
from scipy.stats import chi2
from tests.estimation.conftest import FISHEYE

from omniservo.cameras import ModelError
from omniservo.estimation import estimate_two_view
from omniservo.estimation.arm_views import ArmViews, KnownErrors, LengthPrior, chain_of, with_view
from omniservo.estimation.estimate_arm_views import estimate_arm_views, estimate_at

LENS = 0.02
MOUNT = np.diag(np.square(np.repeat([2e-3, np.radians(0.2)], 3)) / 3.0)
ASIDE = RigidTransform.from_components([0.08, 0.0, 0.0], Rotation.from_rotvec([0.0, -0.15, 0.1]))
LENGTH_SIGMA = 0.05


def seen_by(camera, poses, points):
    pixels, valid = zip(*(camera.project(pose.inv().apply(points)) for pose in poses), strict=True)
    shown = [v & camera.in_image(np.where(v[:, None], p, -1e3)) for p, v in zip(pixels, valid, strict=True)]
    return np.nan_to_num(np.array(pixels)), np.array(shown)


def views_of(seed, *, looks=(ASIDE,), noise=0.5, lens=LENS, field=0.0, wrong=0.0):
    """A scene: its goal, its points, what is stated of it, and what two views say."""
    rng = np.random.default_rng(seed)
    points = np.array([0.0, 0.0, 0.5]) + rng.uniform(-0.15, 0.15, (24, 3))
    goal = RigidTransform.from_components(
        rng.normal(size=3) * 0.1, Rotation.from_rotvec(rng.normal(size=3) * 0.2)
    )
    own = np.array([FISHEYE.fx, FISHEYE.fy, FISHEYE.cx, FISHEYE.cy])
    off = own * (1.0 + lens * rng.standard_normal(4))
    stated = replace(FISHEYE, fx=off[0], fy=off[1], cx=off[2], cy=off[3])
    error = np.sqrt(np.diag(MOUNT)) * rng.standard_normal(6)
    mount = RigidTransform.from_exp_coords(np.concatenate([error[3:], error[:3]]))
    poses = [RigidTransform.identity(), goal, *(mount.inv() * look * mount for look in looks)]
    pixels, seen = seen_by(FISHEYE, poses, points)
    if field:
        stated = replace(stated, model_error=ModelError(field, 0.2 * FISHEYE.width))
        rows = stated.model_error.rows(pixels.reshape(-1, 2))
        pixels = pixels + (rows.T @ rng.standard_normal((len(rows), 2))).reshape(pixels.shape)
    pixels = pixels + noise * rng.standard_normal(pixels.shape)
    lost = rng.random(pixels[2:].shape[:2]) < wrong
    pixels[2:][lost] += rng.normal(size=(lost.sum(), 2)) * 30.0
    seen &= stated.unproject(pixels)[1]
    both = seen[:2].all(axis=0)
    pixels, seen, points = pixels[:, both], seen[:, both], points[both]
    covariance = np.diag([*(lens * own) ** 2, 0.0]) if lens else None
    length = float(np.linalg.norm(goal.translation)) * (1.0 + LENGTH_SIGMA * rng.standard_normal())
    known = KnownErrors(MOUNT, covariance, LengthPrior(length, LENGTH_SIGMA))
    reached = chain_of(RigidTransform.identity(), [None, *looks])
    views = ArmViews(stated, pixels, seen, np.full(seen.shape, max(noise, 1e-3)), reached, known)
    start = estimate_two_view(
        stated, *pixels[:2], scale=length, scale_sigma=LENGTH_SIGMA, calibration_covariance=covariance,
        noise=max(noise, 1e-3),
    )  # fmt: skip
    return goal, points, views, start


def normal_square(goal, estimate):
    """How far the goal's pose is off, over what is stated, squared."""
    turn = (goal.rotation.inv() * estimate.initial_T_goal.rotation).as_rotvec()
    error = np.concatenate((estimate.initial_T_goal.translation - goal.translation, turn))
    return error @ np.linalg.solve(estimate.covariance, error)


@cache
def scenes(**changes):
    found = [views_of(seed, **changes) for seed in range(24)]
    return [scene for scene in found if scene[3].status == "ok"]


@cache
def answered(**changes):
    """The scenes whose views are answered, with the answer."""
    found = [(*scene, estimate_arm_views(*scene[2:])[0]) for scene in scenes(**changes)]
    return [each for each in found if each[-1].status == "ok"]


@pytest.mark.slow
@pytest.mark.parametrize(
    "changes",
    [
        {},
        {"lens": 0.0, "noise": 0.05},
        {"lens": 0.0, "noise": 0.1, "field": 0.3},
        {"lens": 0.0, "wrong": 0.2},
    ],
    ids=["lens 2% off", "mount alone", "model error", "wrong matches"],
)
def test_the_stated_covariance_of_the_goal_holds_the_truth(changes):
    squares = [normal_square(goal, estimate) for goal, *_, estimate in answered(**changes)]
    assert len(squares) > 18
    assert np.mean(np.array(squares) < chi2.ppf(0.95, 6)) > 0.75
    assert 0.2 < np.mean(np.array(squares) < chi2.ppf(0.5, 6)) < 0.85


@pytest.mark.slow
def test_one_more_view_more_than_halves_the_uncertainty_and_the_error_follows():
    before, after, errors = [], [], []
    for goal, _, _, start, estimate in answered():
        for kept, found in ((before, start), (after, estimate)):
            kept.append(np.sqrt(np.trace(found.covariance[:3, :3])))
        errors.append(
            [np.linalg.norm(e.initial_T_goal.translation - goal.translation) for e in (start, estimate)]
        )
    assert np.median(after) < 0.5 * np.median(before)
    assert np.median(errors, axis=0)[1] < 0.7 * np.median(errors, axis=0)[0]


def test_without_noise_goal_points_and_scale_are_found_from_the_displacement_alone():
    goal, points, views, start = views_of(3, noise=0.0, lens=0.0)
    views = replace(views, known=replace(views.known, length=None))
    estimate, optimum = estimate_arm_views(views, start)
    assert estimate.initial_T_goal.translation == pytest.approx(
        goal.translation, abs=2e-3
    )  # the mount's error
    assert estimate.points[estimate.inliers] == pytest.approx(points[estimate.inliers], rel=0.02)
    assert optimum.camera == views.camera


def test_what_is_expected_of_a_view_is_what_it_then_gives():
    ratios = []
    for seed in (2, 5, 6, 7, 8):
        _, _, views, start = views_of(seed, looks=(), lens=0.0)
        _, optimum = estimate_arm_views(views, start)
        expected = estimate_at(with_view(optimum, ASIDE))
        found, _ = estimate_arm_views(*views_of(seed, lens=0.0)[2:])
        ratios.append(np.sqrt(np.trace(expected.covariance[3:, 3:]) / np.trace(found.covariance[3:, 3:])))
    assert 0.5 < np.median(ratios) < 2.0


@pytest.mark.slow
@pytest.mark.parametrize(
    ("view", "is_guess"), [(0, True), (1, False)], ids=["where the arm stands, guessed", "goal, stated"]
)
def test_points_that_one_of_the_first_two_views_shows_elsewhere_are_left_out(view, is_guess):
    squares, gates = [], 0
    for goal, _, views, start in scenes(lens=0.0):
        moved = np.flatnonzero(start.inliers)[2:18:4]
        pixels = views.pixels.copy()
        pixels[view, moved] += [15.0, -15.0]
        estimate, optimum = estimate_arm_views(replace(views, pixels=pixels, is_guess=is_guess), start)
        assert estimate.status == "ok", estimate.message
        gates += estimate.inliers[moved].sum()
        assert np.isfinite(estimate.points[estimate.inliers]).all()
        assert len(optimum.points) == estimate.inliers.sum() > 9
        squares.append(normal_square(goal, estimate))
    assert gates <= 0.03 * len(moved) * len(squares)
    assert np.mean(np.array(squares) < chi2.ppf(0.95, 6)) > 0.75


def test_a_known_length_whose_point_is_left_out_is_no_answer():
    _, points, views, start = views_of(2, lens=0.0)
    first, second = np.flatnonzero(start.inliers)[:2].tolist()
    length = LengthPrior(float(np.linalg.norm(points[first] - points[second])), 0.02, rows=(first, second))
    views = replace(views, known=replace(views.known, length=length))
    assert estimate_arm_views(views, start)[0].status == "ok"
    pixels = views.pixels.copy()
    pixels[0, first] += 20.0
    estimate, optimum = estimate_arm_views(replace(views, pixels=pixels), start)
    assert (estimate.status, optimum) == ("not_converged", None)
    assert "too few pixels" in estimate.message


def test_a_known_length_of_a_point_that_a_further_view_will_not_show_is_not_counted_on():
    """It was an IndexError, which ended a run that was to look again."""
    _, points, views, start = views_of(2, lens=0.0)
    rows = np.flatnonzero(start.inliers)
    bearing = points[rows, 0] / points[rows, 2]
    first, second = int(rows[bearing.argmin()]), int(rows[bearing.argmax()])
    length = LengthPrior(float(np.linalg.norm(points[first] - points[second])), 0.02, rows=(first, second))
    views = replace(views, known=replace(views.known, length=length))
    _, optimum = estimate_arm_views(views, start)
    counts = []
    for turn in np.radians(np.arange(60.0, 110.0)):
        there = RigidTransform.from_rotation(Rotation.from_rotvec([0.0, turn, 0.0]))
        expected = with_view(optimum, there)
        counts.append(len(expected.points))
        assert (expected.views.known.length is None) == (counts[-1] < len(optimum.points))
    assert counts[0] == len(optimum.points)
    assert any(8 <= count < counts[0] for count in counts)


def test_views_that_disagree_are_no_answer():
    _, _, views, start = views_of(4, lens=0.0)
    pixels = views.pixels.copy()
    pixels[1] = pixels[1][::-1]
    estimate, optimum = estimate_arm_views(replace(views, pixels=pixels), start)
    assert optimum is None
    assert estimate.status == "not_converged"
