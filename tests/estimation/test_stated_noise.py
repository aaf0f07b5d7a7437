"""What a caller knows of the pixels' noise weighs the residuals and carries statuses and covariance."""

import math

import numpy as np
import pytest
from scipy.optimize import least_squares
from scipy.spatial.transform import Rotation
from scipy.stats import chi2

from omniservo.errors import InputError
from omniservo.estimation import estimate_two_view


def errors(estimate, scene):
    """Rotation and direction [rad]."""
    t, truth = estimate.initial_T_goal.translation, scene.translation
    swing = math.atan2(np.linalg.norm(np.cross(t, truth)), t @ truth)
    return (estimate.initial_T_goal.rotation.inv() * scene.rotation).magnitude(), swing


def uneven(scene, rng, sigmas):
    """Both images with noise of another size at every point."""
    return (
        scene.pixels_initial + sigmas[:, :1] * rng.normal(size=scene.pixels_initial.shape),
        scene.pixels_goal + sigmas[:, 1:] * rng.normal(size=scene.pixels_goal.shape),
    )


def test_one_number_for_all_moves_only_the_covariance(make_scene):
    rng = np.random.default_rng(71)
    scene = make_scene(rng, n=20)
    pixels = scene.noisy(rng, 0.005)  # so little that the linear picture holds
    plain = estimate_two_view(scene.camera, *pixels)
    stated = [estimate_two_view(scene.camera, *pixels, noise=s) for s in (0.01, 0.02)]
    for estimate in stated:
        np.testing.assert_allclose(
            estimate.initial_T_goal.as_matrix(), plain.initial_T_goal.as_matrix(), atol=1e-6
        )
        assert estimate.noise_px == pytest.approx(plain.noise_px, rel=1e-6)
    np.testing.assert_allclose(stated[1].covariance, 4.0 * stated[0].covariance, rtol=1e-6)
    student = plain.noise_px**2 * 15 / 13
    np.testing.assert_allclose(stated[0].covariance, 1e-4 / student * plain.covariance, rtol=1e-3, atol=1e-12)


@pytest.mark.parametrize("method", ["pixel", "virtual-plane"])
def test_the_answer_is_the_weighted_minimum_that_scipy_finds(make_scene, method):
    rng = np.random.default_rng(72)
    scene = make_scene(rng, n=12)
    sigmas = rng.uniform(0.05, 0.5, (12, 2))
    initial, goal = uneven(scene, rng, sigmas)
    camera = scene.camera

    def image(points):
        if method == "pixel":
            return camera.project(points)[0]
        return points @ camera.matrix.T[:, :2] / points[:, 2:]

    seen = [image(camera.unproject(p)[0]) for p in (initial, goal)]
    length = np.linalg.norm(scene.translation)
    direction = scene.translation / length

    def unpack(x):
        t = direction + x[:3]
        return scene.rotation * Rotation.from_rotvec(x[3:6]), t / np.linalg.norm(t)

    def residuals(x):
        rotation, t = unpack(x)
        points = scene.points / length + x[6:].reshape(-1, 3)
        rest = [(image(points) - seen[0]) / sigmas[:, :1]]
        rest.append((image(rotation.inv().apply(points - t)) - seen[1]) / sigmas[:, 1:])
        return np.append(np.concatenate(rest).ravel(), x[:3] @ direction)

    reference = least_squares(residuals, np.zeros(6 + 36), xtol=1e-15, ftol=1e-15, gtol=1e-12)
    rotation, t = unpack(reference.x)
    estimate = estimate_two_view(camera, initial, goal, method=method, noise=sigmas)
    assert estimate.status == "ok"
    np.testing.assert_allclose(estimate.initial_T_goal.translation, t, atol=5e-5)
    assert (estimate.initial_T_goal.rotation.inv() * rotation).magnitude() < 5e-5


def test_sharp_points_count_more_than_blurred_ones(make_scene):
    rng = np.random.default_rng(73)
    ratios = []
    for _ in range(30):
        scene = make_scene(rng, n=24)
        sigmas = np.where(rng.random((24, 1)) < 0.5, 0.03, 0.6) * np.ones((1, 2))
        pixels = uneven(scene, rng, sigmas)
        blind = estimate_two_view(scene.camera, *pixels, robust=False)
        told = estimate_two_view(scene.camera, *pixels, robust=False, noise=sigmas)
        assert told.status == "ok"
        if blind.status == "ok":
            ratios.append(errors(told, scene)[0] / errors(blind, scene)[0])
    assert len(ratios) >= 25
    assert np.median(ratios) < 0.4


@pytest.mark.slow
@pytest.mark.parametrize("method", ["pixel", "virtual-plane"])
def test_with_the_noise_stated_the_ellipsoid_is_that_of_chi_square(make_scene, method):
    rng = np.random.default_rng(74)
    scene = make_scene(rng, n=20)
    sigmas = rng.uniform(0.02, 0.15, (20, 2))
    direction = scene.translation / np.linalg.norm(scene.translation)
    basis = np.zeros((6, 5))
    basis[:3, :2] = np.linalg.svd(direction[None])[2][1:].T
    basis[3:, 2:] = np.eye(3)
    inside, trials = 0, 300
    for _ in range(trials):
        estimate = estimate_two_view(
            scene.camera, *uneven(scene, rng, sigmas), method=method, noise=sigmas, robust=False
        )
        pose = estimate.initial_T_goal
        turn = (scene.rotation.inv() * pose.rotation).as_rotvec()
        deviation = basis.T @ np.concatenate((pose.translation - direction, turn))
        inside += deviation @ np.linalg.solve(basis.T @ estimate.covariance @ basis, deviation) < chi2.ppf(
            0.95, 5
        )
    # The residuals may only widen the stated noise: a little more than 95%.
    assert 0.93 <= inside / trials <= 0.99


def test_relief_below_the_stated_noise_is_a_plane_and_above_it_is_not(fisheye, make_view):
    rng = np.random.default_rng(75)
    flat = np.column_stack((0.12 * rng.uniform(-1, 1, (20, 2)), 0.008 * rng.uniform(-1, 1, 20)))
    points = Rotation.from_rotvec([0.4, 0.2, 0.0]).apply(flat) + np.array([0, 0, 0.5])
    scene = make_view(fisheye, points, Rotation.from_rotvec([0.1, -0.3, 0.2]), np.array([0.15, -0.05, 0.1]))
    statuses = [
        estimate_two_view(fisheye, scene.pixels_initial, scene.pixels_goal, noise=s).status
        for s in (0.05, 2.0)
    ]
    assert statuses == ["ok", "planar_points"]


def test_pixels_far_noisier_than_stated_are_no_pose(make_scene):
    rng = np.random.default_rng(76)
    scene = make_scene(rng, n=30)
    pixels = scene.noisy(rng, 0.5)
    assert estimate_two_view(scene.camera, *pixels, noise=0.4, robust=False).status == "ok"
    refused = estimate_two_view(scene.camera, *pixels, noise=0.02, robust=False)
    assert refused.status == "not_converged"
    assert "0.02 px" in refused.message


def test_wrong_matches_are_found_at_the_stated_noise(make_scene):
    rng = np.random.default_rng(77)
    scene = make_scene(rng, n=60)
    initial, goal = scene.noisy(rng, 0.1)
    goal[:15] += rng.uniform(20.0, 60.0, (15, 2))
    estimate = estimate_two_view(scene.camera, initial, goal, noise=0.1)
    assert estimate.status == "ok"
    assert estimate.inliers[:15].sum() <= 3
    assert estimate.inliers[15:].sum() >= 42
    assert errors(estimate, scene)[0] < math.radians(2.0)


@pytest.mark.parametrize(
    ("noise", "message"),
    [
        (0.0, "noise: 0 given; legal: > 0"),
        (-1.0, "noise"),
        (math.nan, "noise"),
        ("big", "noise"),
        (np.ones((8, 2)), "noise: 8 rows given; 9 are needed"),
        (np.ones((9, 3)), r"noise: shape \(9, 3\)"),
        (np.zeros((9, 2)), "noise: 0 given; legal: > 0"),
    ],
)
def test_an_illegal_noise_says_what_is_legal(make_scene, noise, message):
    scene = make_scene(np.random.default_rng(78), n=9)
    with pytest.raises(InputError, match=message):
        estimate_two_view(scene.camera, scene.pixels_initial, scene.pixels_goal, noise=noise)


@pytest.mark.slow
def test_seven_matches_that_contradict_the_stated_noise_have_a_covariance(make_scene):
    """Of two degrees of freedom it was a ZeroDivisionError where the covariance was read."""
    contradicted = 0
    for seed in range(300):
        rng = np.random.default_rng(seed)
        scene = make_scene(rng, n=7)
        found = estimate_two_view(scene.camera, *scene.noisy(rng, 1.2), noise=0.5)
        if found.status == "ok":
            assert np.isfinite(found.covariance).all()
            contradicted += np.isfinite(found.uncertainty.freedom)
    assert contradicted > 0
