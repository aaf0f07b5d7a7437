"""Corners of one view err together: what views disagree by bounds a calibration's covariance from below."""

import math

import board_views
import numpy as np
import pytest
from benchmarks.calibration_accuracy import real_sets
from benchmarks.calibration_halves import PIXELS, apart, by_us, part

from omniservo import calibrate_camera, preset
from omniservo.calibration.adjustment.lens import from_physical
from omniservo.calibration.adjustment.poses import poses_from_corners
from omniservo.calibration.adjustment.refine import linearise, refine
from omniservo.calibration.adjustment.uncertainty import (
    jackknife_covariance,
    larger_covariance,
    theta_covariance,
)
from omniservo.calibration.adjustment.views import read_views

LENS = preset("fe185")
PLAIN = np.arange(9) < 5


@pytest.fixture(scope="module")
def adjusted():
    """Nine views whose corners are off by what each view bends alike, and the camera they give."""
    pixels, points = bent_views(3)
    return camera_of(pixels, points)


def bent_views(seed):
    """Corners and points of nine views."""
    rng = np.random.default_rng(seed)
    pixels, points = board_views.draw_views(LENS, rng, views=9, noise_px=0.02)
    local = points[0][:, :2] - points[0][:, :2].mean(axis=0)
    bend = (local / np.abs(local).max(axis=0)) ** 2
    return [p + bend @ rng.normal(scale=0.3, size=(2, 2)) for p in pixels], points


def camera_of(pixels, points):
    """Views, the camera and poses that fit them best, and the variance that is left [px²]."""
    views, _ = read_views(pixels, points, (LENS.width, LENS.height))
    theta = np.array(from_physical((LENS.fx, LENS.fy, LENS.cx, LENS.cy, LENS.xi, 0.0, 0.0, 0.0, 0.0)))
    state, cost, converged = refine(views, poses_from_corners(views, theta, 1.0), PLAIN)
    assert converged
    return views, state, cost / (2 * len(views.pixels) - 5 - 6 * views.count)


def test_the_jackknife_is_that_of_cameras_without_each_view(adjusted):
    views, state, _ = adjusted
    found = jackknife_covariance(linearise(views, state, np.ones(len(views.pixels))), PLAIN)
    steps = []
    for left in range(views.count):
        rest = np.flatnonzero(np.arange(views.count) != left)
        steps.append(refine(views.some(rest), state.some(rest), PLAIN)[0].theta - state.theta)
    explicit = (views.count - 1) / views.count * np.transpose(steps) @ np.array(steps)
    np.testing.assert_allclose(np.sqrt(np.diag(found)), np.sqrt(np.diag(explicit)), rtol=0.1, atol=1e-12)


def test_what_views_disagree_by_is_more_than_independent_corners_would_say(adjusted):
    views, state, variance = adjusted
    normal = linearise(views, state, np.ones(len(views.pixels)))
    alone = theta_covariance(normal, PLAIN, variance)
    together = larger_covariance(alone, jackknife_covariance(normal, PLAIN), PLAIN)
    assert np.linalg.eigvalsh(together - alone)[0] > -1e-9 * np.linalg.eigvalsh(together)[-1]
    grown = np.sqrt(np.diag(together)[:5] / np.diag(alone)[:5])
    assert grown.max() > 1.5


def test_a_calibration_states_no_less_than_views_disagree_by():
    pixels, points = bent_views(5)
    views, state, _ = camera_of(pixels, points)
    jackknife = jackknife_covariance(linearise(views, state, np.ones(len(views.pixels))), PLAIN)
    found = calibrate_camera(pixels, points, (LENS.width, LENS.height), distortion="none")
    centre = slice(2, 4)  # cx, cy: the same parameters in both
    assert np.all(found.standard_deviations[centre] > 0.98 * np.sqrt(np.diag(jackknife)[centre]))


def test_the_larger_of_two_covariances_holds_both():
    rng = np.random.default_rng(4)
    one, other = (x @ x.T for x in rng.normal(size=(2, 9, 9)))
    both, free = larger_covariance(one, other, np.ones(9, dtype=bool)), np.ones(9, dtype=bool)
    for part_of_it in (one, other):
        assert np.linalg.eigvalsh(both - part_of_it)[0] > -1e-9
    np.testing.assert_allclose(larger_covariance(one, 0.0 * one, free), one, rtol=1e-8, atol=1e-10)


@pytest.mark.slow
@pytest.mark.usefixtures("shared_data")
def test_two_halves_of_real_views_differ_by_little_more_than_they_state():
    corners = next(each for each in real_sets() if each.name == "fisheye1")
    pixels = np.concatenate(corners.pixels)
    at = pixels[np.random.default_rng(0).permutation(len(pixels))[:PIXELS]]
    halves = [by_us(part(corners, list(range(k, 15, 2))), None, at)[0] for k in (0, 1)]
    differ, use = apart(halves[0], halves[1].bearings[0])
    stated = math.sqrt(sum(float(np.mean(half.stated[use] ** 2)) for half in halves))
    assert (
        differ < 1.7 * stated
    )  # 1.79 without the views' part, 1.78 without the longer fields', 2.8 without both
