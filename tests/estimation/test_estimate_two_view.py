import math

import numpy as np
import pytest
from scipy.optimize import least_squares
from scipy.spatial.transform import RigidTransform, Rotation

from omniservo.estimation import estimate_two_view
from omniservo.estimation.matches import Matches
from omniservo.estimation.refinement.joint_refinement import refine_jointly
from omniservo.estimation.robust.two_view_fit import fit_two_views
from omniservo.geometry.quaternions import QUATERNION


def rotation_error(estimate, scene):
    return math.degrees((estimate.initial_T_goal.rotation.inv() * scene.rotation).magnitude())


def direction_error(estimate, scene):
    a, b = estimate.initial_T_goal.translation, scene.translation
    return math.degrees(math.atan2(np.linalg.norm(np.cross(a, b)), a @ b))


def assert_exact(estimate, scene, atol=1e-8):
    assert estimate.status == "ok"
    assert estimate.inliers.all()
    np.testing.assert_allclose(estimate.initial_T_goal.translation, scene.translation, atol=atol)
    np.testing.assert_allclose(
        estimate.initial_T_goal.rotation.as_matrix(), scene.rotation.as_matrix(), atol=atol
    )
    np.testing.assert_allclose(estimate.points, scene.points, atol=atol)


@pytest.mark.parametrize("method", ["pixel", "virtual-plane"])
@pytest.mark.parametrize("rotation", ["quaternion", "cayley"])
def test_exact_pixels_give_the_exact_answer(camera, make_scene, method, rotation):
    rng = np.random.default_rng(21)
    for n in (8, 9, 30, 100):
        scene = make_scene(rng, n=n, camera=camera, turn=0.2)
        estimate = estimate_two_view(
            camera,
            scene.pixels_initial,
            scene.pixels_goal,
            scale=float(np.linalg.norm(scene.translation)),
            method=method,
            rotation=rotation,
        )
        assert_exact(estimate, scene)
        assert estimate.rms_px < 1e-8


@pytest.mark.parametrize("example", [1, 2])
@pytest.mark.parametrize("method", ["pixel", "virtual-plane"])
def test_the_papers_targets_are_answered_at_every_noise_of_detected_dots(make_paper_scene, example, method):
    scene = make_paper_scene(example)
    rng = np.random.default_rng(22)
    for sigma, bound in ((0.0, 1e-6), (0.02, 1.5), (0.05, 3.5)):
        for _ in range(10):
            estimate = estimate_two_view(scene.camera, *scene.noisy(rng, sigma), method=method)
            assert estimate.status == "ok"
            assert rotation_error(estimate, scene) < bound


def test_points_past_90_degrees_are_full_members(fisheye, make_view):
    rng = np.random.default_rng(23)
    ring = np.array([[math.cos(a), math.sin(a), 0.0] for a in rng.uniform(-0.6, 0.6, 12)])
    points = 0.5 * ring * rng.uniform(0.7, 1.3, (12, 1)) + [0, 0, -0.03]
    points[:, 2] -= rng.uniform(0.0, 0.08, 12)
    scene = make_view(fisheye, points, Rotation.from_rotvec([0.05, -0.1, 0.1]), np.array([0.05, 0.1, -0.05]))
    assert (points[:, 2] < 0).all()
    estimate = estimate_two_view(
        fisheye, scene.pixels_initial, scene.pixels_goal, scale=float(np.linalg.norm(scene.translation))
    )
    assert_exact(estimate, scene, atol=1e-7)


def test_both_parametrisations_and_both_starts_of_robustness_agree(make_scene):
    rng = np.random.default_rng(24)
    for n in (9, 60):
        scene = make_scene(rng, n=n)
        pixels = scene.noisy(rng, 0.1)
        one = estimate_two_view(scene.camera, *pixels, rotation="quaternion", robust=False)
        other = estimate_two_view(scene.camera, *pixels, rotation="cayley", robust=False)
        assert one.status == other.status == "ok"
        np.testing.assert_allclose(
            one.initial_T_goal.as_matrix(), other.initial_T_goal.as_matrix(), atol=1e-5
        )
        assert one.rms_px == pytest.approx(other.rms_px, rel=1e-8)


@pytest.mark.slow
@pytest.mark.parametrize("method", ["pixel", "virtual-plane"])
def test_the_answer_is_the_minimum_that_scipy_finds_from_the_truth(make_scene, method):
    rng = np.random.default_rng(25)
    scene = make_scene(rng, n=12)
    initial, goal = scene.noisy(rng, 0.2)
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
        rotation = scene.rotation * Rotation.from_rotvec(x[3:6])
        return rotation, t / np.linalg.norm(t), scene.points / length + x[6:].reshape(-1, 3)

    def residuals(x):
        rotation, t, points = unpack(x)
        goal_points = rotation.inv().apply(points - t)
        rest = np.concatenate(((image(points) - seen[0]).ravel(), (image(goal_points) - seen[1]).ravel()))
        return np.append(rest, x[:3] @ direction)

    reference = least_squares(residuals, np.zeros(6 + 36), xtol=1e-15, ftol=1e-15, gtol=1e-12)
    rotation, t, points = unpack(reference.x)
    estimate = estimate_two_view(camera, initial, goal, method=method)
    assert estimate.status == "ok"
    np.testing.assert_allclose(estimate.initial_T_goal.translation, t, atol=2e-5)
    assert (estimate.initial_T_goal.rotation.inv() * rotation).magnitude() < 2e-5
    np.testing.assert_allclose(estimate.points, points, atol=2e-4)


def test_nine_noisy_points_hardly_ever_end_above_the_minimum_next_to_the_truth(make_scene):
    rng = np.random.default_rng(26)
    above = 0
    for _ in range(60):
        scene = make_scene(rng, spread=0.1)
        pixels = np.hstack(scene.noisy(rng, 0.5))
        matches = Matches.of_pixels(scene.camera, pixels)
        found = fit_two_views(matches, QUATERNION, robust=False)
        r, t, points = scene.rotation.as_matrix(), np.array(scene.translation), scene.points.copy()
        best, _ = refine_jointly(matches.parameters, pixels, matches.weights, QUATERNION, r, t, points, 200)
        above += found.cost > 1.001 * best
    assert above <= 2


def test_thirty_of_a_hundred_wrong_matches_are_found(make_scene):
    rng = np.random.default_rng(27)
    for _ in range(5):
        scene = make_scene(rng, n=100)
        initial, goal = scene.noisy(rng, 0.2)
        wrong = rng.permutation(100) < 30
        goal[wrong] = rng.uniform([100, 50], [550, 400], (30, 2))
        estimate = estimate_two_view(scene.camera, initial, goal)
        assert estimate.status == "ok"
        sigma = math.degrees(math.sqrt(estimate.covariance[3:, 3:].trace()))
        assert rotation_error(estimate, scene) < 4 * sigma < 9.0
        assert (estimate.inliers & ~wrong).sum() >= 68
        assert (estimate.inliers & wrong).sum() <= 4
        assert np.isnan(estimate.points_covariance[~estimate.inliers]).all()
        assert np.isfinite(estimate.points[estimate.inliers]).all()


def test_one_gross_match_among_twelve_is_rejected_and_clean_ones_are_kept(make_scene):
    rng = np.random.default_rng(28)
    found = 0
    for j in range(12):
        scene = make_scene(rng, n=12)
        initial, goal = scene.noisy(rng, 0.03)
        assert estimate_two_view(scene.camera, initial, goal).inliers.all()
        # Along its epipolar curve a wrong match is a right one at another distance; across, it is wrong.
        nearer = scene.points[j] * 0.99
        along = scene.camera.project(scene.initial_T_goal.inv().apply(nearer))[0] - scene.pixels_goal[j]
        goal[j] += 40.0 * np.array([-along[1], along[0]]) / np.linalg.norm(along)
        estimate = estimate_two_view(scene.camera, initial, goal)
        found += estimate.status == "ok" and np.flatnonzero(~estimate.inliers).tolist() == [j]
    # Twelve points can bend to one wrong match, so not every one can be found.
    assert found >= 10


def test_the_same_input_gives_the_same_answer(make_scene):
    rng = np.random.default_rng(29)
    scene = make_scene(rng, n=60)
    initial, goal = scene.noisy(rng, 0.2)
    goal[:15] += rng.normal(scale=30.0, size=(15, 2))
    one, other = (estimate_two_view(scene.camera, initial, goal) for _ in range(2))
    np.testing.assert_array_equal(one.points, other.points)
    np.testing.assert_array_equal(one.inliers, other.inliers)


def test_a_point_nearly_at_infinity_does_not_spoil_the_rest(fisheye, make_view):
    rng = np.random.default_rng(30)
    points = np.array([0.0, 0.0, 0.5]) + 0.12 * rng.uniform(-1, 1, (20, 3))
    points[0] = [1e3, 2e3, 5e3]
    scene = make_view(fisheye, points, Rotation.from_rotvec([0.1, 0.05, 0]), np.array([0.1, 0.1, 0.05]))
    estimate = estimate_two_view(fisheye, *scene.noisy(rng, 0.05))
    assert estimate.status == "ok"
    assert rotation_error(estimate, scene) < 1.0
    assert estimate.points_covariance[0].trace() > 1e3 * estimate.points_covariance[1].trace()


def test_residuals_are_projection_minus_pixel(make_scene):
    rng = np.random.default_rng(31)
    scene = make_scene(rng, n=15)
    initial, goal = scene.noisy(rng, 0.1)
    estimate = estimate_two_view(scene.camera, initial, goal)
    pose: RigidTransform = estimate.initial_T_goal
    again = np.hstack(
        [
            scene.camera.project(estimate.points)[0] - initial,
            scene.camera.project(pose.inv().apply(estimate.points))[0] - goal,
        ]
    )
    np.testing.assert_allclose(estimate.residuals_px, again, atol=1e-9)
    assert estimate.rms_px == pytest.approx(math.sqrt((again**2).sum() / 30))
    assert estimate.noise_px == pytest.approx(math.sqrt((again**2).sum() / 10))
