import numpy as np
import pytest
from scipy.stats import chi2, f

from omniservo.estimation import estimate_two_view


def error(estimate, scene, translation):
    pose = estimate.initial_T_goal
    return np.concatenate(
        (pose.translation - translation, (scene.rotation.inv() * pose.rotation).as_rotvec())
    )


def test_without_a_length_the_translation_is_one_and_the_answer_is_not_metric(make_scene):
    scene = make_scene(np.random.default_rng(51))
    estimate = estimate_two_view(scene.camera, scene.pixels_initial, scene.pixels_goal)
    assert not estimate.is_metric
    assert np.linalg.norm(estimate.initial_T_goal.translation) == pytest.approx(1.0, abs=1e-14)


@pytest.mark.parametrize("kind", ["displacement", "length"])
def test_one_known_length_scales_translation_and_every_point(make_scene, kind):
    rng = np.random.default_rng(52)
    scene = make_scene(rng, n=12)
    pixels = scene.noisy(rng, 0.05)
    known = float(np.linalg.norm(scene.points[2] - scene.points[7]))
    scale = 0.37 if kind == "displacement" else ((2, 7), known)
    plain = estimate_two_view(scene.camera, *pixels)
    metric = estimate_two_view(scene.camera, *pixels, scale=scale)
    assert metric.is_metric
    ratio = np.linalg.norm(metric.initial_T_goal.translation)
    np.testing.assert_allclose(metric.points, ratio * plain.points, rtol=1e-12)
    np.testing.assert_allclose(
        metric.initial_T_goal.translation, ratio * plain.initial_T_goal.translation, rtol=1e-12
    )
    if kind == "displacement":
        assert ratio == pytest.approx(0.37)
    else:
        assert np.linalg.norm(metric.points[2] - metric.points[7]) == pytest.approx(known)


@pytest.mark.slow
@pytest.mark.parametrize("method", ["pixel", "virtual-plane"])
def test_the_95_percent_ellipsoid_covers_95_percent(make_scene, method):
    rng = np.random.default_rng(53)
    scene = make_scene(rng, n=20)
    direction = scene.translation / np.linalg.norm(scene.translation)
    basis = np.zeros((6, 5))
    basis[:3, :2] = np.linalg.svd(direction[None])[2][1:].T
    basis[3:, 2:] = np.eye(3)
    inside = {"chi2": 0, "f": 0}
    trials = 400
    for _ in range(trials):
        estimate = estimate_two_view(scene.camera, *scene.noisy(rng, 0.1), method=method, robust=False)
        deviation = basis.T @ error(estimate, scene, direction)
        square = deviation @ np.linalg.solve(basis.T @ estimate.covariance @ basis, deviation)
        inside["chi2"] += square < chi2.ppf(0.95, 5)
        # Student's t with 15 degrees of freedom: covariance 15/13 of its scale matrix.
        inside["f"] += square * 15 / 13 < 5 * f.ppf(0.95, 5, 15)
    assert 0.92 <= inside["f"] / trials <= 0.98
    assert 0.90 <= inside["chi2"] / trials <= 0.98


@pytest.mark.slow
@pytest.mark.parametrize("kind", ["none", "displacement", "length"])
def test_covariance_of_motion_and_points_is_that_of_repeated_noise(make_scene, kind):
    rng = np.random.default_rng(54)
    scene = make_scene(rng, n=30)
    length = float(np.linalg.norm(scene.translation))
    scale = {
        "none": None,
        "displacement": length,
        "length": ((3, 4), float(np.linalg.norm(scene.points[3] - scene.points[4]))),
    }[kind]
    unit = length if kind == "none" else 1.0
    motions, points, predicted, predicted_points = [], [], [], []
    for _ in range(250):
        estimate = estimate_two_view(scene.camera, *scene.noisy(rng, 0.05), scale=scale, robust=False)
        motions.append(error(estimate, scene, scene.translation / unit))
        points.append(estimate.points - scene.points / unit)
        predicted.append(estimate.covariance)
        predicted_points.append(estimate.points_covariance)
    # 30 points: E of the Student covariance is 25/23 · 25/25 of the truth; noise of 250 trials is 4.5%.
    expected = np.mean(predicted, axis=0) * 23 / 25
    np.testing.assert_allclose(
        np.sqrt(np.diag(np.cov(np.array(motions).T)) / np.diag(expected)), 1.0, atol=0.15
    )
    spread = np.var(np.array(points), axis=0)
    expected_points = np.array([np.diag(c) for c in np.mean(predicted_points, axis=0)]) * 23 / 25
    assert np.median(np.sqrt(spread / expected_points)) == pytest.approx(1.0, abs=0.1)


def test_translation_of_known_length_has_no_variance_along_itself(make_scene):
    rng = np.random.default_rng(55)
    scene = make_scene(rng, n=15)
    estimate = estimate_two_view(scene.camera, *scene.noisy(rng, 0.1), scale=0.2)
    along = np.concatenate((estimate.initial_T_goal.translation / 0.2, np.zeros(3)))
    assert along @ estimate.covariance @ along < 1e-12 * estimate.covariance[:3, :3].trace()
    assert np.linalg.eigvalsh(estimate.covariance)[1] > 0


def test_uncertainty_is_worked_out_when_read_and_once(make_scene):
    scene = make_scene(np.random.default_rng(5), n=20)
    estimate = estimate_two_view(scene.camera, *scene.noisy(np.random.default_rng(6), 0.1))
    assert estimate.covariance is estimate.covariance
    assert estimate.uncertainty is estimate.uncertainty
