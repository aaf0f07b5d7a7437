"""Which points are followed when there are more than the servo needs."""

from dataclasses import replace

import numpy as np
import pytest

from omniservo.cameras import preset
from omniservo.estimation import estimate_two_view
from omniservo.runs.followed_points import MOST_POINTS, followed_points

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
