"""Several views refined together, against SciPy's least squares."""

import numpy as np
import pytest
from scipy.optimize import least_squares
from scipy.spatial.transform import Rotation

from omniservo.cameras import preset
from omniservo.estimation.refinement.bundle_adjustment import adjust_views, cost_of_views

CAMERA = preset("fe185")
SCALE_VIEW = 2


def scene(seed, views=5, n=12, noise=0.3):
    rng = np.random.default_rng(seed)
    points = np.array([0.0, 0.0, 0.5]) + rng.uniform(-0.15, 0.15, (n, 3))
    poses = np.zeros((views, 7))
    poses[:, 3] = 1.0
    for v in range(1, views):
        poses[v, :4] = Rotation.from_rotvec(0.15 * rng.normal(size=3)).as_quat()
        poses[v, 4:] = 0.08 * rng.normal(size=3)
    pixels = np.stack([look(pose, points) for pose in poses])
    return poses, points, pixels + noise * rng.standard_normal(pixels.shape), rng


def look(pose, points):
    return CAMERA.project(Rotation.from_quat(pose[:4]).inv().apply(points - pose[4:]))[0]


def guess(poses, points, rng):
    start = poses.copy()
    for v in range(1, len(poses)):
        turn = Rotation.from_quat(poses[v, :4]) * Rotation.from_rotvec(0.02 * rng.normal(size=3))
        start[v, :4] = turn.as_quat()
        start[v, 4:] += 0.01 * rng.normal(size=3)
    start[SCALE_VIEW, 4:] *= np.linalg.norm(poses[SCALE_VIEW, 4:]) / np.linalg.norm(start[SCALE_VIEW, 4:])
    return start, points + 0.02 * rng.normal(size=points.shape)


def scipys_minimum(pixels, seen, poses, points):
    """The same cost in SciPy's parameters: rotation vectors, and points; the scale is free."""
    views = len(poses)

    def residuals(x):
        motions, places = x[: 6 * (views - 1)].reshape(-1, 6), x[6 * (views - 1) :].reshape(-1, 3)
        rows = [(look(poses[0], places) - pixels[0])[seen[0]]]
        for v, motion in enumerate(motions, start=1):
            pose = np.concatenate((Rotation.from_rotvec(motion[3:]).as_quat(), motion[:3]))
            rows.append((look(pose, places) - pixels[v])[seen[v]])
        return np.concatenate(rows).ravel()

    start = [np.concatenate((p[4:], Rotation.from_quat(p[:4]).as_rotvec())) for p in poses[1:]]
    found = least_squares(residuals, np.concatenate((*start, points.ravel())), xtol=1e-12, ftol=1e-12)
    return 2.0 * found.cost


@pytest.mark.parametrize("hidden", [0.0, 0.2])
def test_the_minimum_is_that_of_scipy(hidden):
    poses, points, pixels, rng = scene(3)
    seen = rng.uniform(size=pixels.shape[:2]) >= hidden
    seen[:3] = True
    start, places = guess(poses, points, rng)
    least = scipys_minimum(pixels, seen, poses, points)
    pixels[~seen] = np.nan
    cost, converged = adjust_views(CAMERA.parameters, pixels, seen, SCALE_VIEW, 100, start, places)
    assert converged
    assert cost == pytest.approx(least, rel=1e-7)
    assert cost == pytest.approx(cost_of_views(CAMERA.parameters, pixels, seen, start, places))


def test_without_noise_the_truth_comes_back_with_the_scale_of_the_named_view():
    poses, points, pixels, rng = scene(4, noise=0.0)
    start, places = guess(poses, points, rng)
    seen = np.ones(pixels.shape[:2], dtype=bool)
    cost, converged = adjust_views(CAMERA.parameters, pixels, seen, SCALE_VIEW, 100, start, places)
    assert converged
    assert cost < 1e-12
    scale = np.linalg.norm(start[SCALE_VIEW, 4:]) / np.linalg.norm(poses[SCALE_VIEW, 4:])
    assert scale == pytest.approx(1.0, abs=1e-12)
    np.testing.assert_allclose(places, points, atol=1e-7)
    np.testing.assert_array_equal(start[0], poses[0])


def test_a_point_that_nobody_sees_stays_but_for_the_scale():
    poses, points, pixels, _ = scene(5)
    seen = np.ones(pixels.shape[:2], dtype=bool)
    seen[:, 7] = False
    places = points.copy()
    _, converged = adjust_views(CAMERA.parameters, pixels, seen, SCALE_VIEW, 100, poses.copy(), places)
    assert converged
    np.testing.assert_allclose(places[7], points[7], rtol=1e-2)


def test_a_guess_outside_the_cameras_domain_is_no_convergence():
    poses, points, pixels, _ = scene(6)
    places = points.copy()
    places[0] = [0.0, 0.0, -1.0]
    seen = np.ones(pixels.shape[:2], dtype=bool)
    cost, converged = adjust_views(CAMERA.parameters, pixels, seen, SCALE_VIEW, 100, poses, places)
    assert cost == np.inf
    assert not converged
