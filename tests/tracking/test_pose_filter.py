"""The pose filter: its motion model, its update, and what it is worth."""

import numpy as np
from kinematic_loop import FISHEYE, FRONT, PERSPECTIVE, Loop, Path, bent_path, plan_of
from scipy.optimize import least_squares
from scipy.spatial.transform import RigidTransform, Rotation
from scipy.stats import chi2, f

from omniservo.estimation import refine_pose
from omniservo.tracking import PathTracker, TrackerOptions
from omniservo.tracking.pose_filter import (
    UNPLANNED_SPEED,
    UNPLANNED_TURN,
    correct_state,
    covariance_at_start,
    predict_state,
)


def row(pose):
    return np.concatenate((pose.rotation.as_quat(), pose.translation))


def pose_of(values):
    return RigidTransform.from_components(values[4:], Rotation.from_quat(values[:4]))


def moved(pose, step):
    """(translation in the reference frame, rotation vector on the right) added to a pose."""
    return RigidTransform.from_components(
        pose.translation + step[:3], pose.rotation * Rotation.from_rotvec(step[3:])
    )


def gap(pose, other):
    turn = (pose.rotation.inv() * other.rotation).as_rotvec()
    return np.concatenate((other.translation - pose.translation, turn))


A = RigidTransform.from_components([0.1, -0.2, 0.3], Rotation.from_rotvec([0.4, -0.9, 0.3]))
BEFORE = RigidTransform.from_components([0.02, 0.1, -0.1], Rotation.from_rotvec([0.1, 0.2, -0.3]))
AFTER = RigidTransform.from_components([0.05, 0.14, 0.1], Rotation.from_rotvec([-0.2, 0.3, 0.5]))


def predicted(pose, covariance, seconds=0.0):
    values, predicted_covariance = row(pose), covariance.copy()
    predict_state(values, predicted_covariance, row(BEFORE), row(AFTER), seconds)
    return pose_of(values), predicted_covariance


def test_between_images_the_estimate_moves_as_the_plan_does():
    pose, _ = predicted(A, np.eye(6))
    np.testing.assert_allclose(pose.as_matrix(), (A * BEFORE.inv() * AFTER).as_matrix(), atol=1e-14)


def test_the_predicted_covariance_is_that_of_the_linearised_motion():
    step = 1e-6
    centre, _ = predicted(A, np.eye(6))
    transition = np.column_stack(
        [gap(centre, predicted(moved(A, step * e), np.eye(6))[0]) / step for e in np.eye(6)]
    )
    prior = np.cov(np.random.default_rng(0).standard_normal((6, 40)))
    _, found = predicted(A, prior, 0.1)
    noise = np.repeat([(0.1 * UNPLANNED_SPEED) ** 2, (0.1 * UNPLANNED_TURN) ** 2], 3)
    np.testing.assert_allclose(found, transition @ prior @ transition.T + np.diag(noise), atol=1e-5)


def wider(degrees):
    """How much larger than the mean square of so few residuals a variance has to be taken."""
    return 6.0 * f.ppf(0.95, 6, degrees) / chi2.ppf(0.95, 6)


def test_the_update_is_the_least_squares_of_prediction_and_image():
    """Against SciPy's: of the residuals L⁻¹ gap, P = L Lᵀ, and those of the pixels over σ."""
    rng = np.random.default_rng(1)
    seen = bent_path()(0.4)
    pixels = Loop(FISHEYE, pose=seen).look() + 0.3 * rng.standard_normal((9, 2))
    fit = refine_pose(FISHEYE, FRONT, pixels, seen)
    prediction = moved(fit.reference_T_camera, [1e-3, -2e-3, 1e-3, 2e-3, 1e-3, -1e-3])
    prior = np.diag([2e-6, 1e-6, 3e-6, 1e-6, 2e-6, 4e-6])
    values, covariance = row(prediction), prior.copy()
    estimate, everything = (values, covariance, np.zeros(2)), np.ones(9, bool)
    measured = row(fit.reference_T_camera)
    correct_state(FISHEYE.parameters, FRONT, pixels, everything, measured, np.zeros(6), estimate)

    def residuals(pose):
        return (FISHEYE.project(pose.inv().apply(FRONT))[0] - pixels).ravel()

    variance = wider(12) * np.mean(residuals(fit.reference_T_camera) ** 2) * 18 / 12
    root = np.linalg.inv(np.linalg.cholesky(prior))

    def both(step):
        pose = moved(prediction, step)
        return np.concatenate((root @ gap(prediction, pose), residuals(pose) / np.sqrt(variance)))

    best = least_squares(both, np.zeros(6), x_scale=1e-3, xtol=1e-14, ftol=1e-14, gtol=1e-14)
    np.testing.assert_allclose(gap(prediction, pose_of(values)), best.x, atol=2e-6)
    np.testing.assert_allclose(covariance, np.linalg.inv(best.jac.T @ best.jac), rtol=1e-3, atol=5e-10)


def test_an_image_of_an_uncertain_stamp_draws_less_along_the_flow_than_across():
    """Against SciPy's least squares, the pixels whitened by σ² 1 + (flow σₜ)(flow σₜ)ᵀ."""
    rng = np.random.default_rng(4)
    seen = bent_path()(0.4)
    pixels = Loop(FISHEYE, pose=seen).look() + 0.3 * rng.standard_normal((9, 2))
    fit = refine_pose(FISHEYE, FRONT, pixels, seen).reference_T_camera
    stamp = 2e-2 * np.array([0.05, -0.12, 0.2, 0.3, -0.2, 0.1])
    prediction = moved(fit, [1e-3, -2e-3, 1e-3, 2e-3, 1e-3, -1e-3])
    prior = np.diag([2e-6, 1e-6, 3e-6, 1e-6, 2e-6, 4e-6])
    values, covariance = row(prediction), prior.copy()
    estimate, everything = (values, covariance, np.zeros(2)), np.ones(9, bool)
    correct_state(FISHEYE.parameters, FRONT, pixels, everything, row(prediction), stamp, estimate)
    found = pose_of(values)

    def residuals(pose):
        return (FISHEYE.project(pose.inv().apply(FRONT))[0] - pixels).ravel()

    along = np.concatenate((found.rotation.apply(stamp[:3]), stamp[3:]))
    flow = (residuals(moved(found, 1e-2 * along)) - residuals(moved(found, -1e-2 * along))) / 2e-2
    variance = wider(12) * np.mean(residuals(prediction) ** 2) * 18 / 12
    white = np.linalg.inv(np.linalg.cholesky(variance * np.eye(18) + np.outer(flow, flow)))
    root = np.linalg.inv(np.linalg.cholesky(prior))

    def both(step):
        pose = moved(prediction, step)
        return np.concatenate((root @ gap(prediction, pose), white @ residuals(pose)))

    best = least_squares(both, np.zeros(6), x_scale=1e-3, xtol=1e-14, ftol=1e-14, gtol=1e-14)
    np.testing.assert_allclose(gap(prediction, found), best.x, atol=5e-6)


def test_an_uncertain_stamp_is_pixel_noise_along_every_points_flow():
    """Against generalised least squares of the pixels with covariance σ² 1 + (flow σₜ)(flow σₜ)ᵀ."""
    rng = np.random.default_rng(3)
    seen = bent_path()(0.4)
    pixels = Loop(FISHEYE, pose=seen).look() + 0.3 * rng.standard_normal((9, 2))
    fit = refine_pose(FISHEYE, FRONT, pixels, seen)
    pose, sigma = fit.reference_T_camera, 4e-3
    twist = np.array([0.05, -0.12, 0.2, 0.3, -0.2, 0.1])
    prior = np.diag([2e-6, 1e-6, 3e-6, 1e-6, 2e-6, 4e-6])

    def projected(off):
        return FISHEYE.project(moved(pose, off).inv().apply(FRONT))[0].ravel()

    jacobian = np.array([(projected(h) - projected(-h)) / 2e-6 for h in 1e-6 * np.eye(6)]).T
    step = 1e-4
    place = pose * RigidTransform.from_exp_coords(np.concatenate((twist[3:], twist[:3])) * step)
    flow = (FISHEYE.project(place.inv().apply(FRONT))[0].ravel() - projected(np.zeros(6))) / step
    noise = np.linalg.inv(wider(12) * jacobian.T @ jacobian @ fit.covariance).trace() / 6.0
    weights = np.linalg.inv(np.eye(18) / noise + sigma**2 * np.outer(flow, flow))
    covariance = prior.copy()
    estimate, everything = (row(pose), covariance, np.zeros(2)), np.ones(9, bool)
    correct_state(FISHEYE.parameters, FRONT, pixels, everything, row(pose), sigma * twist, estimate)
    expected = np.linalg.inv(np.linalg.inv(prior) + jacobian.T @ weights @ jacobian)
    np.testing.assert_allclose(covariance, expected, rtol=2e-2, atol=1e-9)
    sharp = prior.copy()
    estimate = row(pose), sharp, np.zeros(2)
    correct_state(FISHEYE.parameters, FRONT, pixels, everything, row(pose), np.zeros(6), estimate)
    along = np.concatenate((pose.rotation.apply(twist[:3]), twist[3:]))
    assert along @ np.linalg.solve(sharp, along) > 1.2 * along @ np.linalg.solve(covariance, along)


def test_the_first_image_of_a_good_target_decides():
    seen = bent_path()(0.2)
    pixels = Loop(FISHEYE, pose=seen).look()
    fit = refine_pose(FISHEYE, FRONT, pixels, seen).reference_T_camera
    values, covariance = row(moved(seen, np.full(6, 0.01))), covariance_at_start()
    estimate, everything = (values, covariance, np.zeros(2)), np.ones(9, bool)
    correct_state(FISHEYE.parameters, FRONT, pixels, everything, row(fit), np.zeros(6), estimate)
    np.testing.assert_allclose(gap(fit, pose_of(values)), 0.0, atol=3e-5)


def test_the_filtered_pose_is_nearer_to_the_truth_than_that_of_single_images():
    period = 1.0 / 30.0
    loop = Loop(FISHEYE, noise=0.5, period=period)
    tracker = PathTracker(plan_of(), FISHEYE, options=TrackerOptions(delay=0.5 * period))
    single, joined, normalised = [], [], []
    for k in range(110):
        truth = loop.pose
        twist = tracker.step(k * period, loop.look())
        report = tracker.report
        single.append(gap(truth, report.initial_T_camera))
        joined.append(gap(truth, pose_of(report.filtered_pose)))
        normalised.append(joined[-1] @ np.linalg.solve(report.filtered_covariance, joined[-1]))
        loop.pose = loop.pose * RigidTransform.from_exp_coords(
            np.concatenate((twist[3:], twist[:3])) * period
        )
    rms = [np.sqrt(np.mean(np.square(np.array(e)[10:, :3]).sum(1))) for e in (single, joined)]
    assert rms[1] < 0.7 * rms[0]
    assert np.mean(normalised[10:]) < 2.0 * 6.0


def test_few_points_state_an_error_of_about_its_size_and_filter_it():
    """Two degrees of freedom are left: by one image's residuals its pose would seem exact now and then."""
    still = Path(np.array([[0.0, 0.0]] * 3 + [[0.0, 1.0]]), np.zeros((3, 2)))
    points, single, joined, normalised = FRONT[[0, 2, 6, 8]], [], [], []
    seen = FISHEYE.project(points)[0]
    for seed in range(12):
        rng = np.random.default_rng(seed)
        tracker = PathTracker(plan_of(points, still), FISHEYE)
        for k in range(40):
            tracker.step(k / 30.0, seen + 0.5 * rng.standard_normal(seen.shape))
            off = gap(RigidTransform.identity(), pose_of(tracker.report.filtered_pose))
            single.append(tracker.report.pose[4:])
            joined.append(off[:3])
            normalised.append(off @ np.linalg.solve(tracker.report.filtered_covariance, off))
    assert np.linalg.norm(joined) < 0.45 * np.linalg.norm(single)
    assert np.median(normalised) < 3 * 5.3  # of χ²(6)


def test_the_ellipsoid_of_four_points_covers_the_truth_as_often_as_it_says():
    """Of a tag nearly face on: of one image, and of fifteen, which single poses joined are far from."""
    half = 30.0 / 420.0 * 1.3 / 2.0
    corners = np.array([[-half, -half, 0], [half, -half, 0], [half, half, 0], [-half, half, 0]])
    place = moved(RigidTransform.identity(), [0.02, 0.01, 0.65, 0.0, np.radians(12.0), 0.0])
    points = place.apply(corners)
    still = Path(np.array([[0.0, 0.0]] * 3 + [[0.0, 1.0]]), np.zeros((3, 2)))
    seen, first, last = PERSPECTIVE.project(points)[0], [], []
    for seed in range(100):
        rng = np.random.default_rng(seed)
        tracker = PathTracker(plan_of(points, still), PERSPECTIVE)
        for k in range(15):
            tracker.step(k / 30.0, seen + 0.2 * rng.standard_normal(seen.shape))
            off = gap(pose_of(tracker.report.filtered_pose), RigidTransform.identity())
            square = off @ np.linalg.solve(tracker.report.filtered_covariance, off)
            if k in (0, 14):
                (first if k == 0 else last).append(square)
    within = chi2.ppf(0.95, 6)
    assert np.mean(np.array(first) <= within) > 0.85
    assert np.mean(np.array(last) <= within) > 0.88
    assert np.mean(last) < 1.5 * 6.0


def test_the_first_image_of_a_small_tag_does_not_turn_the_camera():
    """Of the two orientations that it leaves the wrong one may fit better, and nearly exactly, by chance.

    By the image alone the 95% ellipsoid has the truth in 40 to 75%.
    """
    still = Path(np.array([[0.0, 0.0]] * 3 + [[0.0, 1.0]]), np.zeros((3, 2)))
    normalised = []
    for seed in range(150):
        rng = np.random.default_rng(seed)
        half = rng.choice([16.0, 30.0]) / PERSPECTIVE.fx * 0.65 / 2.0
        corners = half * np.array([[-1.0, -1, 0], [1, -1, 0], [1, 1, 0], [-1, 1, 0]])
        tilt = rng.choice([0.03, 0.3]) * rng.normal(size=2)
        points = moved(RigidTransform.identity(), [0.02, 0.01, 0.65, *tilt, rng.uniform(-0.5, 0.5)]).apply(
            corners
        )
        tracker = PathTracker(plan_of(points, still), PERSPECTIVE)
        tracker.step(0.0, PERSPECTIVE.project(points)[0] + 0.3 * rng.standard_normal((4, 2)))
        off = gap(pose_of(tracker.report.filtered_pose), RigidTransform.identity())
        normalised.append(off @ np.linalg.solve(tracker.report.filtered_covariance, off))
    assert np.mean(np.array(normalised) <= chi2.ppf(0.95, 6)) > 0.95
    assert np.max(normalised) < 60.0
