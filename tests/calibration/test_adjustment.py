"""The parts of the calibration: derivatives against differences, covariance against simulation."""

import numpy as np
import pytest
from board_views import board, draw_views
from scipy.optimize import least_squares
from scipy.spatial.transform import Rotation
from scipy.stats import chi2

from omniservo import UnifiedCamera, preset
from omniservo.calibration.adjustment import lens
from omniservo.calibration.adjustment.equivalence import equivalents, same_pixels
from omniservo.calibration.adjustment.poses import poses_from_corners
from omniservo.calibration.adjustment.refine import State, linearise, refine, residuals
from omniservo.calibration.adjustment.uncertainty import pixel_bound, ray_deviation, theta_covariance
from omniservo.calibration.adjustment.views import read_views

DISTORTED = UnifiedCamera(420, -425, 319, 235, 0.9, 640, 480, distortion=(-0.28, 0.07, 2e-3, -1e-3))
ALL = np.ones(9, dtype=bool)


def theta_of(camera):
    return lens.from_physical([camera.fx, camera.fy, camera.cx, camera.cy, camera.xi, *camera.distortion])


def difference(function, x, step=1e-6):
    columns = []
    for i in range(len(x)):
        ahead, behind = np.array(x, dtype=float), np.array(x, dtype=float)
        h = step * max(1.0, abs(x[i]))
        ahead[i] += h
        behind[i] -= h
        columns.append((function(ahead) - function(behind)) / (2.0 * h))
    return np.stack(columns, -1)


@pytest.fixture
def points():
    rays = np.random.default_rng(0).normal([0.0, 0.0, 0.7], size=(40, 3))
    return rays[rays[:, 2] > -0.1 * np.linalg.norm(rays, axis=1)]


@pytest.mark.parametrize(
    "camera", [DISTORTED, preset("fe185"), preset("perspective")], ids=lambda c: f"{c.xi}"
)
def test_the_lens_is_the_unified_camera_in_other_parameters(camera, points):
    theta = theta_of(camera)
    np.testing.assert_allclose(theta_of(lens.camera_of(theta, (640, 480))), theta, rtol=1e-12)
    pixels, valid = camera.project(points)
    assert valid.sum() > 10
    np.testing.assert_allclose(lens.project(theta, points)[0][valid], pixels[valid], atol=1e-9)
    bearings, ok = lens.unproject(theta, pixels[valid])
    assert ok.all()
    unit = points[valid] / np.linalg.norm(points[valid], axis=1, keepdims=True)
    np.testing.assert_allclose(bearings, unit, atol=1e-9)


def test_derivatives_of_the_projection_are_right(points):
    theta = theta_of(DISTORTED)
    pixels, by_theta, by_point, ok = lens.project_jacobian(theta, points)
    points, by_theta, by_point = points[ok], by_theta[ok], by_point[ok]
    np.testing.assert_allclose(pixels[ok], lens.project(theta, points)[0], atol=1e-12)
    wanted = difference(lambda t: lens.project(t, points)[0], theta)
    np.testing.assert_allclose(by_theta, wanted, rtol=1e-6, atol=1e-5)
    for i, point in enumerate(points):
        wanted = difference(lambda p: lens.project(theta, p[None])[0][0], point)
        np.testing.assert_allclose(by_point[i], wanted, rtol=1e-6, atol=1e-4)


def test_derivatives_of_the_physical_parameters_are_right():
    theta = theta_of(DISTORTED)
    wanted = difference(lens.to_physical, theta)
    np.testing.assert_allclose(lens.physical_jacobian(theta), wanted, rtol=1e-6, atol=1e-6)


def small_problem(seed=0, *, views=6, noise_px=0.3, camera=None):
    camera = preset("fe185") if camera is None else camera
    rng = np.random.default_rng(seed)
    target = board(5, 4, 0.05)
    seen = draw_views(camera, rng, views=views, noise_px=0.0, target=target, distances=(0.08, 0.2))
    drawn, _ = read_views(*seen, (camera.width, camera.height))
    state = poses_from_corners(drawn, theta_of(camera), 1.0)
    noisy = drawn.pixels + rng.normal(scale=noise_px, size=drawn.pixels.shape)
    return drawn, state, noisy


def with_pixels(views, pixels):
    return type(views)(pixels, views.points, views.ends, views.numbers)


def test_the_gradient_of_the_cost_is_right_for_camera_and_poses():
    drawn, state, noisy = small_problem(views=3)
    views = with_pixels(drawn, noisy)

    def cost(x):
        turned = Rotation.from_rotvec(x[9:].reshape(3, 6)[:, :3]).as_matrix() @ state.rotations
        moved = State(x[:9], turned, state.translations + x[9:].reshape(3, 6)[:, 3:])
        return np.array([0.5 * (residuals(views, moved) ** 2).sum()])

    blocks = linearise(views, state, np.ones(len(noisy))).blocks
    gradient = np.concatenate([blocks[:, :9, 15].sum(0), blocks[:, 9:15, 15].ravel()])
    wanted = difference(cost, np.concatenate([state.theta, np.zeros(18)]))[0]
    np.testing.assert_allclose(gradient, wanted, rtol=1e-4, atol=1e-3)


def test_the_minimum_is_the_one_that_scipy_finds():
    drawn, state, noisy = small_problem(seed=3, views=4)
    views = with_pixels(drawn, noisy)
    found, cost, converged = refine(views, state, lens.PLAIN)

    def errors(x):
        turned = Rotation.from_rotvec(x[5:].reshape(4, 6)[:, :3]).as_matrix() @ state.rotations
        theta = np.concatenate([x[:5], np.zeros(4)])
        return residuals(views, State(theta, turned, state.translations + x[5:].reshape(4, 6)[:, 3:])).ravel()

    start = np.concatenate([state.theta[:5], np.zeros(24)])
    reference = least_squares(errors, start, x_scale="jac", xtol=1e-12, ftol=1e-12, gtol=1e-12)
    assert converged
    assert cost == pytest.approx(2.0 * reference.cost, rel=1e-8)
    np.testing.assert_allclose(found.theta[:5], reference.x[:5], rtol=1e-5)


@pytest.mark.slow
def test_covariance_pixel_bound_and_ray_deviation_hold_in_simulation():
    drawn, state, _ = small_problem(views=8)
    covered = 1.2
    rays = lens.field(state.theta, (659, 432), covered)
    truth, _ = lens.project(state.theta, rays)
    rng = np.random.default_rng(1)
    distances, inside, thetas, runs = [], 0, [], 100
    for _ in range(runs):
        views = with_pixels(drawn, drawn.pixels + rng.normal(scale=0.3, size=drawn.pixels.shape))
        found, cost, converged = refine(views, state, lens.PLAIN)
        assert converged
        freedom = 2 * len(drawn.pixels) - 5 - 6 * 8
        normal = linearise(views, found, np.ones(len(drawn.pixels)))
        covariance = theta_covariance(normal, lens.PLAIN, cost / freedom)
        away = (found.theta - state.theta)[:5]
        distances.append(away @ np.linalg.solve(covariance[:5, :5], away))
        bound = pixel_bound(found.theta, covariance, rays, turned=False)
        pixels, _ = lens.project(found.theta, rays)
        inside += np.linalg.norm(pixels - truth, axis=1).max() <= bound
        thetas.append(found.theta)
    # Mahalanobis distances are χ² with 5 degrees: mean 5, and a twentieth beyond the 95% quantile
    assert 4.2 < np.mean(distances) < 5.9
    assert 0.89 <= np.mean(np.array(distances) <= chi2.ppf(0.95, 5)) <= 0.995
    assert 0.89 <= inside / runs <= 0.995
    angle = np.array([0.8])
    stated = ray_deviation(found.theta, covariance, angle, turned=False)[0]
    ring = np.arange(16) * (np.pi / 8)
    directions = np.stack(
        [np.sin(0.8) * np.cos(ring), np.sin(0.8) * np.sin(ring), np.full(16, np.cos(0.8))], 1
    )
    at, _ = lens.project(state.theta, directions)
    seen = np.stack([lens.unproject(theta, at)[0] for theta in thetas])
    measured = np.sqrt(((seen - directions) ** 2).sum(2).mean())
    assert stated == pytest.approx(measured, rel=0.15)


def test_equivalent_cameras_have_the_stated_pixels_after_the_best_rotation():
    camera = UnifiedCamera(420, 425, 319, 235, 0.9, 640, 480, distortion=(-0.28, 0.07, 1e-3, -5e-4))
    theta = theta_of(camera)
    rays = lens.field(theta, (640, 480), 0.8)
    for entry in equivalents(theta, ALL, rays):
        alpha = entry.xi / (1.0 + entry.xi)
        other, _ = same_pixels(theta, theta, alpha, ALL, rays)
        stated = lens.camera_of(other, (640, 480))

        def away(turn, stated=stated):
            pixels, valid = stated.project(Rotation.from_rotvec(turn).apply(rays))
            assert valid.all()
            return (pixels - camera.project(rays)[0]).ravel()

        best = least_squares(away, np.zeros(3), x_scale=1e-3)
        rms = np.sqrt(2.0 * best.cost / len(rays))
        assert rms == pytest.approx(entry.rms_px, abs=0.003)
        assert entry.rms_px < 0.1
    plain = equivalents(
        theta_of(preset("fe185")), lens.PLAIN, lens.field(theta_of(preset("fe185")), (659, 432), 1.5)
    )
    assert max(e.xi for e in plain) / min(e.xi for e in plain) < 1.02
    assert len(plain) >= 3


def test_a_pose_is_found_from_bearings_past_ninety_degrees():
    camera = preset("para-catadioptric")
    pose = Rotation.from_euler("yxz", [89.0, 8.0, 30.0], degrees=True)
    target = board()
    seen = pose.apply(target - target.mean(0)) + 0.9 * pose.apply([0.0, 0.0, 1.0])
    pixels, valid = camera.project(seen)
    assert valid.all()
    assert (seen[:, 2] < 0.0).any()
    views, _ = read_views([pixels], [target], (camera.width, camera.height))
    state = poses_from_corners(views, theta_of(camera), 1.0)
    np.testing.assert_allclose(state.points(views), seen, atol=1e-7)
