"""How exactly a camera's parameters are known counts in every pose of known points."""

import numpy as np
import pytest
from numpy.testing import assert_allclose
from scipy.spatial.transform import RigidTransform, Rotation
from scipy.stats import chi2

from omniservo.cameras import UnifiedCamera, preset
from omniservo.cameras.calibration_covariance import covariance_directions
from omniservo.estimation import estimate_known_target, estimate_pose

EXACT = preset("fe185")
ROOT = np.diag([0.7, 0.7, 0.5, 0.5, 0.005]) @ np.random.default_rng(40).normal(size=(5, 5))
COVARIANCE = ROOT @ ROOT.T
KNOWN = UnifiedCamera.from_dict({**EXACT.to_dict(), "calibration_covariance": COVARIANCE})
DIRECTIONS = covariance_directions(COVARIANCE)
TAG = 0.08 * np.array([[-1.0, -1.0, 0.0], [1.0, -1.0, 0.0], [1.0, 1.0, 0.0], [-1.0, 1.0, 0.0]])
SIGMA = 0.05
RUNS = 150


def off_by(change):
    """The camera whose parameters differ from the stated ones."""
    fx, fy, cx, cy, xi = np.array([EXACT.fx, EXACT.fy, EXACT.cx, EXACT.cy, EXACT.xi]) + change
    return UnifiedCamera(fx, fy, cx, cy, xi, EXACT.width, EXACT.height)


def scene(rng, points, camera, noise=SIGMA):
    """Two poses that see the points, and their pixels in a camera."""
    poses, seen = [], []
    for _ in range(2):
        turn = Rotation.from_rotvec(0.3 * rng.normal(size=3))
        centre = turn.apply([*rng.uniform(-0.1, 0.1, 2), -rng.uniform(0.4, 0.6)])
        poses.append(RigidTransform.from_components(centre, turn))
        pixels = camera.project(poses[-1].inv().apply(points))[0]
        seen.append(pixels + noise * rng.normal(size=pixels.shape))
    return poses, seen


def step(pose, truth):
    turn = (truth.rotation.inv() * pose.rotation).as_rotvec()
    return np.concatenate((pose.translation - truth.translation, turn))


def held(error, covariance):
    return error @ np.linalg.solve(covariance, error) < chi2.ppf(0.95, 6)


@pytest.mark.slow
@pytest.mark.parametrize(("count", "noise"), [(4, SIGMA), (40, SIGMA), (40, None)])
def test_poses_of_a_tag_and_of_a_target_cover_parameters_that_are_off_as_stated(count, noise):
    rng, one, two, exact = np.random.default_rng(4), 0, 0, 0
    for _ in range(RUNS):
        points = TAG if count == 4 else rng.uniform(-0.15, 0.15, (count, 3))
        (first, second), pixels = scene(
            rng, points, off_by(rng.standard_normal(len(DIRECTIONS)) @ DIRECTIONS)
        )
        pose = estimate_pose(KNOWN, points, pixels[0], noise=noise)
        one += held(step(pose.reference_T_camera, first), pose.covariance)
        motion = estimate_known_target(KNOWN, points, *pixels, noise=noise)
        two += held(step(motion.initial_T_goal, first.inv() * second), motion.covariance)
        pose = estimate_pose(EXACT, points, pixels[0], noise=noise)
        exact += pose.status == "ok" and held(step(pose.reference_T_camera, first), pose.covariance)
    assert 0.9 * RUNS <= one <= 0.98 * RUNS
    assert 0.9 * RUNS <= two <= 0.98 * RUNS
    assert exact < 0.7 * RUNS


def test_a_known_target_moves_with_the_parameters_as_its_law_says():
    rng = np.random.default_rng(2)
    points = rng.uniform(-0.15, 0.15, (12, 3))
    (first, second), pixels = scene(rng, points, EXACT, noise=0.0)
    found = estimate_known_target(KNOWN, points, *pixels, noise=SIGMA)
    law = found.uncertainty
    for row, change in zip(law.calibration, law.camera, strict=True):
        camera = off_by(0.3 * change)
        moved = [camera.project(pose.inv().apply(points))[0] for pose in (first, second)]
        other = estimate_known_target(KNOWN, points, *moved, noise=SIGMA)
        off = step(first.inv() * second, other.initial_T_goal)
        assert_allclose(off, 0.3 * row[:6], atol=0.02 * np.abs(row[:6]).max())


def test_stated_noise_is_not_contradicted_by_what_the_parameters_do():
    rng = np.random.default_rng(3)
    for _ in range(30):
        points = rng.uniform(-0.15, 0.15, (40, 3))
        _, pixels = scene(rng, points, off_by(rng.standard_normal(len(DIRECTIONS)) @ DIRECTIONS))
        found = estimate_pose(KNOWN, points, pixels[0], noise=SIGMA)
        assert (found.status, found.message) == ("ok", "")
        assert found.inliers.sum() >= 38
