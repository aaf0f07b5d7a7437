"""Which points are followed when there are more than the servo needs."""

from dataclasses import replace

import numpy as np
import pytest
from benchmarks.lens_conversions import PUBLISHED
from scipy.spatial.transform import RigidTransform

from omniservo.cameras import preset
from omniservo.cameras.conversion import to_unified
from omniservo.estimation import estimate_two_view
from omniservo.looks.followed_points import ENOUGH, MOST_POINTS, followed_points, shown_at_ends
from omniservo.runs.plan_task import problem_of
from omniservo.tasks import load_task

CAMERA = preset("fe185")


@pytest.fixture(scope="module")
def many():
    rng = np.random.default_rng(0)
    points = np.array([0.0, 0.0, 0.5]) + rng.uniform(-0.2, 0.2, (150, 3))
    initial, goal = CAMERA.project(points)[0], CAMERA.project(points - [0.1, 0.02, 0.05])[0]
    noisy = [pixels + 0.1 * rng.standard_normal(pixels.shape) for pixels in (initial, goal)]
    noisy[1][:10] += np.outer(np.tile([1.0, -1.0], 5), [20.0, -15.0])
    return noisy[0], estimate_two_view(CAMERA, *noisy, scale=0.1)


def test_wrong_matches_are_never_followed(many):
    initial, estimate = many
    chosen = followed_points(estimate, initial)
    assert len(chosen) == MOST_POINTS
    assert (np.diff(chosen) > 0).all()
    assert estimate.inliers[chosen].all()
    assert chosen.min() >= 10


def test_they_are_spread_over_what_all_points_cover(many):
    initial, estimate = many
    chosen = initial[followed_points(estimate, initial)]
    gaps = np.linalg.norm(chosen[:, None] - chosen, axis=2) + 1e9 * np.eye(len(chosen))
    crowd = initial[10 : 10 + MOST_POINTS]
    crowded = np.linalg.norm(crowd[:, None] - crowd, axis=2) + 1e9 * np.eye(MOST_POINTS)
    assert np.median(gaps.min(axis=1)) > 1.2 * np.median(crowded.min(axis=1))


def test_few_points_are_all_followed_but_the_rejected(many):
    initial, estimate = many
    few = replace(estimate, inliers=estimate.inliers & (np.arange(150) < 40))
    np.testing.assert_array_equal(followed_points(few, initial), np.arange(10, 40))


def test_what_no_path_would_show_is_not_followed_where_enough_is_left(many):
    initial, estimate = many
    shown = initial[:, 0] < 300.0
    chosen = followed_points(estimate, initial, shown)
    assert ENOUGH <= len(chosen) <= MOST_POINTS
    assert shown[chosen].all()
    few = np.zeros(len(initial), dtype=bool)
    few[20 : 20 + ENOUGH - 1] = True
    assert (followed_points(estimate, initial, few) == followed_points(estimate, initial)).all()


def test_the_points_shown_at_both_ends_keep_the_margin_and_what_a_conversion_leaves(many):
    """A natural feature near the image's edge refuses no run."""
    lens = PUBLISHED["RealSense, colour"]
    task = load_task("textured-object", camera=lens)
    unified = to_unified(lens).camera
    points = np.column_stack([np.linspace(-0.4, 0.4, 400), np.zeros(400), np.full(400, 0.55)])
    pose = RigidTransform.from_translation([0.02, 0.0, 0.0])
    estimate = replace(many[1], initial_T_goal=pose, points=points, inliers=np.ones(400, dtype=bool))
    problem = problem_of(task, pose, points)
    shown, margin = shown_at_ends(problem, estimate), problem.image_margin
    assert margin > task.planning.visibility_margin + 1.0
    u = np.stack([unified.project(p)[0][:, 0] for p in (points, pose.inv().apply(points))])
    left = np.minimum(u + 0.5, unified.width - 0.5 - u).min(axis=0) - margin
    assert (left[shown] > 0.0).all()
    assert (left[~shown] < 4.0).all(), "but for what the polygon of a distorted camera leaves out"


def test_no_point_is_followed_twice_where_the_image_shows_several_at_one_place_or_some_nowhere(many):
    initial, estimate = many
    crowded = np.tile(initial[20:30], (15, 1))
    some = np.where((np.arange(150) % 7 == 0)[:, None], np.nan, initial)
    for pixels in (crowded, some):
        chosen = followed_points(estimate, pixels)
        assert len(np.unique(chosen)) == MOST_POINTS
    assert np.isfinite(some[chosen]).all()
