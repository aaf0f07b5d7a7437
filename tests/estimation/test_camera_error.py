import dataclasses

import numpy as np
import pytest
from benchmarks.coverage import field_coverage
from benchmarks.estimation_speed import random_scene
from numpy.testing import assert_allclose

from omniservo.cameras import ModelError, UnifiedCamera, preset
from omniservo.estimation import estimate_two_view
from omniservo.estimation.matches import Matches
from omniservo.estimation.uncertainty.shared_camera_error import epipolar_normals


def erring(name="fe185", sigma=0.3):
    exact = preset(name)
    error = {"sigma_px": sigma, "length_px": 0.2 * exact.width}
    return UnifiedCamera.from_dict({**exact.to_dict(), "model_error": error})


@pytest.mark.slow
@pytest.mark.parametrize("name", ["fe185", "perspective"])
def test_an_ellipsoid_covers_a_smooth_lens_error_that_is_stated_and_not_one_that_is_not(name):
    found = field_coverage(name, 0.3, 60, 0.1, 100)
    assert found["stated"] >= 0.85
    assert found["not stated"] < 0.5
    assert found["ok"] == 1.0


def test_more_points_do_not_make_an_estimate_surer_than_its_camera():
    camera, sizes = erring(), []
    for n in (50, 200, 800):
        scene = random_scene(np.random.default_rng(4), camera, n, 0.02)
        found = estimate_two_view(camera, scene.pixels_initial, scene.pixels_goal, noise=0.02, robust=False)
        sizes.append(np.sqrt(np.trace(found.covariance[3:, 3:])))
    assert sizes[2] > 0.5 * sizes[0]


def test_samples_spread_as_the_covariance_with_the_camera_error_says():
    camera = erring()
    scene = random_scene(np.random.default_rng(3), camera, 60, 0.05)
    found = estimate_two_view(camera, scene.pixels_initial, scene.pixels_goal, noise=0.05)
    drawn = found.sample(np.random.default_rng(0), 4000).initial_T_goal
    turns = (found.initial_T_goal.rotation.inv() * drawn.rotation).as_rotvec()
    assert_allclose(turns.std(axis=0), np.sqrt(np.diag(found.covariance)[3:]), rtol=0.06)
    assert len(found.uncertainty.calibration) > 0


def test_normals_and_slopes_of_the_epipolar_geometry_are_those_of_finite_differences():
    camera = preset("fe185")
    scene = random_scene(np.random.default_rng(5), camera, 12, 0.0)
    pixels = np.hstack([scene.pixels_initial, scene.pixels_goal])
    rotation = scene.initial_T_goal.rotation.as_matrix()
    t = scene.initial_T_goal.translation
    t = t / np.linalg.norm(t)

    def constraint(moved):
        b = Matches.of_pixels(camera, moved).bearings
        return np.sum(b[:, :3] * np.cross(t, b[:, 3:] @ rotation.T), axis=1)

    normals, _ = epipolar_normals(Matches.of_pixels(camera, pixels), rotation, t)
    step = 1e-4
    slopes = np.stack(
        [(constraint(pixels + step * e) - constraint(pixels - step * e)) / (2 * step) for e in np.eye(4)], 1
    )
    assert_allclose(normals, slopes / np.linalg.norm(slopes, axis=1, keepdims=True), atol=1e-6)


def test_stated_errors_that_the_residuals_contradict_are_raised_and_that_is_said():
    camera, rng = erring(sigma=0.1), np.random.default_rng(6)
    scene = random_scene(rng, camera, 100, 0.3)
    found = estimate_two_view(camera, scene.pixels_initial, scene.pixels_goal, noise=0.02)
    assert found.status == "ok"
    assert "contradict the stated errors" in found.message
    right = estimate_two_view(camera, scene.pixels_initial, scene.pixels_goal, noise=0.3)
    assert right.message == ""
    ratio = np.sqrt(np.diag(found.covariance) / np.diag(right.covariance))
    assert np.all((ratio > 0.9) & (ratio < 4.0))


def test_noise_of_the_pixels_alone_is_what_is_left_of_the_residuals_beside_the_camera_error():
    camera, exact = erring(sigma=0.5), preset("fe185")
    scene = random_scene(np.random.default_rng(7), camera, 200, 0.3)
    own = [
        estimate_two_view(c, scene.pixels_initial, scene.pixels_goal, robust=False).uncertainty
        for c in (camera, exact)
    ]
    sizes = [np.trace(law.noise[:, 3:6].T @ law.noise[:, 3:6]) for law in own]
    assert sizes[0] < sizes[1]


def test_rows_of_a_model_error_make_up_its_covariance():
    pixels = np.random.default_rng(0).uniform(0.0, 600.0, (80, 2))
    error = ModelError(0.3, 90.0)
    rows = error.rows(pixels)
    assert_allclose(rows.T @ rows, error.covariance(pixels, pixels), atol=2e-3 * 0.09)
    assert len(ModelError(0.0, 90.0).rows(pixels)) == 0


def test_a_point_that_stays_has_one_error_in_both_images():
    pixels = np.tile(np.random.default_rng(1).uniform(0.0, 600.0, (9, 2)), 2)
    moves = ModelError(0.3, 90.0).moves(pixels)
    assert_allclose(moves[:, :, :2], moves[:, :, 2:])
    assert_allclose(np.einsum("knc,knc->nc", moves, moves), 0.09, rtol=3e-3)


def test_a_camera_without_error_is_estimated_as_one_that_states_none():
    scene = random_scene(np.random.default_rng(2), preset("fe185"), 30, 0.2)
    plain, zero = (
        estimate_two_view(c, scene.pixels_initial, scene.pixels_goal)
        for c in (preset("fe185"), erring(sigma=0.0))
    )
    assert_allclose(plain.covariance, zero.covariance)
    assert dataclasses.replace(plain, seconds=0.0).message == zero.message == ""
