import numpy as np
import pytest
from numpy.testing import assert_allclose
from scipy.spatial.transform import RigidTransform, Rotation
from scipy.stats import chi2

from omniservo.cameras import ModelError, UnifiedCamera, preset
from omniservo.estimation import TwoViewEstimate, estimate_pose, estimate_views
from omniservo.estimation.estimate_known_target import estimate_known_target
from omniservo.estimation.uncertainty.pose_response import pose_response

EXACT = preset("fe185")
ERROR = ModelError(0.3, 0.2 * EXACT.width)
ERRING = UnifiedCamera.from_dict({**EXACT.to_dict(), "model_error": ERROR.to_dict()})
SIGMA = 0.05


def scene(rng, n=40):
    """A target, two poses that see it, and their pixels with noise and one smooth error for both."""
    points = rng.uniform(-0.15, 0.15, (n, 3))
    poses, seen = [], []
    for _ in range(2):
        turn = Rotation.from_rotvec(0.3 * rng.normal(size=3))
        centre = turn.apply([*rng.uniform(-0.1, 0.1, 2), -rng.uniform(0.4, 0.6)])
        poses.append(RigidTransform.from_components(centre, turn))
        seen.append(EXACT.project(poses[-1].inv().apply(points))[0])
    moves = ERROR.moves(np.concatenate(seen, axis=1))
    field = np.einsum("k,knc->nc", rng.standard_normal(len(moves)), moves)
    pixels = [p + field[:, 2 * i : 2 * i + 2] + SIGMA * rng.normal(size=p.shape) for i, p in enumerate(seen)]
    return points, poses, pixels


def step(pose, truth):
    return np.concatenate(
        (pose.translation - truth.translation, (truth.rotation.inv() * pose.rotation).as_rotvec())
    )


def held(error, covariance):
    return error @ np.linalg.solve(covariance, error) < chi2.ppf(0.95, 6)


@pytest.mark.parametrize("noise", [SIGMA, None])
def test_a_pose_covers_a_smooth_lens_error_that_is_stated_and_not_one_that_is_not(noise):
    rng, hits = np.random.default_rng(1), {True: 0, False: 0}
    for _ in range(100):
        points, poses, pixels = scene(rng)
        for camera in (EXACT, ERRING):
            found = estimate_pose(camera, points, pixels[0], noise=noise, robust=False)
            hits[camera is ERRING] += held(step(found.reference_T_camera, poses[0]), found.covariance)
    assert hits[True] >= 85
    assert hits[False] < 50


def test_two_pictures_of_a_known_target_share_the_error_of_their_camera():
    rng, hits = np.random.default_rng(2), {True: 0, False: 0}
    for _ in range(100):
        points, poses, pixels = scene(rng)
        truth = poses[0].inv() * poses[1]
        for camera in (EXACT, ERRING):
            found = estimate_known_target(camera, points, *pixels, noise=SIGMA, robust=False)
            hits[camera is ERRING] += held(step(found.initial_T_goal, truth), found.covariance)
    assert hits[True] >= 85
    assert hits[False] < 50


def test_the_response_of_a_pose_is_that_of_finite_differences():
    points, poses, _ = scene(np.random.default_rng(3), n=7)
    pixels = EXACT.project(poses[0].inv().apply(points))[0]
    found = estimate_pose(EXACT, points, pixels, robust=False).reference_T_camera
    response, _ = pose_response(EXACT, (points, np.ones(7)), np.ones(7, dtype=bool), found)
    for j, c in ((0, 0), (3, 1)):
        moved = pixels.copy()
        moved[j, c] += 0.01
        other = estimate_pose(EXACT, points, moved, robust=False).reference_T_camera
        assert_allclose(step(other, found) / 0.01, response[j, :, c], atol=2e-3 * np.abs(response).max())


def test_an_estimate_with_a_camera_error_is_saved_and_loaded(tmp_path):
    points, _, pixels = scene(np.random.default_rng(4), n=12)
    found = estimate_known_target(ERRING, points, *pixels, noise=SIGMA)
    found.save(tmp_path / "estimate.json")
    loaded = TwoViewEstimate.load(tmp_path / "estimate.json")
    assert_allclose(loaded.uncertainty.calibration, found.uncertainty.calibration)
    assert len(loaded.uncertainty.calibration) > 0


def views_of(rng, count, n=40):
    """Pixels (count, n, 2) of a target with noise and one smooth error, and the views in the first one."""
    points, poses = rng.uniform(-0.15, 0.15, (n, 3)), []
    for k in range(count):
        turn = Rotation.from_rotvec(0.2 * rng.normal(size=3))
        centre = turn.apply([0.1 * k, rng.uniform(-0.1, 0.1), -rng.uniform(0.4, 0.6)])
        poses.append(RigidTransform.from_components(centre, turn))
    seen = np.concatenate([EXACT.project(p.inv().apply(points))[0] for p in poses], axis=1)
    moves = ERROR.moves(seen)
    seen += np.einsum("k,knc->nc", rng.standard_normal(len(moves)), moves) + SIGMA * rng.normal(
        size=seen.shape
    )
    return np.swapaxes(seen.reshape(n, count, 2), 0, 1), [poses[0].inv() * p for p in poses]


@pytest.mark.slow
def test_several_views_cover_a_smooth_lens_error_that_is_stated_and_not_one_that_is_not():
    rng, hits = np.random.default_rng(5), {True: 0, False: 0}
    for _ in range(40):
        pixels, truth = views_of(rng, 4)
        length = float(np.linalg.norm(truth[1].translation))
        for camera in (EXACT, ERRING):
            found = estimate_views(camera, pixels, scale=length, noise=SIGMA, robust=False)
            hits[camera is ERRING] += held(step(found.initial_T_views[3], truth[3]), found.covariance[3])
    assert hits[True] >= 0.85 * 40
    assert hits[False] < 0.5 * 40


def test_more_views_do_not_make_an_estimate_surer_than_its_camera():
    sizes = []
    for count in (3, 12):
        pixels, truth = views_of(np.random.default_rng(6), count)
        length = float(np.linalg.norm(truth[1].translation))
        found = estimate_views(ERRING, pixels, scale=length, noise=0.02, robust=False)
        sizes.append(np.sqrt(np.trace(found.covariance[1, 3:, 3:])))
    assert sizes[1] > 0.4 * sizes[0]


def test_a_view_of_several_has_the_law_of_its_covariance():
    pixels, _ = views_of(np.random.default_rng(7), 3)
    found = estimate_views(ERRING, pixels, scale=0.1, noise=SIGMA)
    law = found.two_view(2).uncertainty
    assert len(law.calibration) > 0
    assert_allclose(law.covariances()[0], found.covariance[2], rtol=1e-6, atol=1e-14)


def test_noise_that_a_smooth_error_does_not_explain_is_raised_and_said():
    rng, squares = np.random.default_rng(5), []
    for _ in range(40):
        points, poses, pixels = scene(rng)
        noisy = [p + 0.3 * rng.normal(size=p.shape) for p in pixels]
        found = estimate_known_target(ERRING, points, *noisy, noise=0.01)
        assert "the residuals contradict the stated noise, which is taken" in found.message
        alone = estimate_pose(ERRING, points, noisy[0], noise=0.01)
        assert "the residuals contradict the stated noise" in alone.message
        error = step(found.initial_T_goal, poses[0].inv() * poses[1])
        squares.append(error @ np.linalg.solve(found.covariance, error))
    assert np.mean(np.array(squares) < chi2.ppf(0.95, 6)) > 0.85


def test_noise_that_is_stated_rightly_is_not_raised():
    rng = np.random.default_rng(6)
    for _ in range(30):
        points, _, pixels = scene(rng)
        assert estimate_pose(ERRING, points, pixels[0], noise=SIGMA, robust=False).message == ""
