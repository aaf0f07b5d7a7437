"""Matches whose windows overlap err alike, and tell less of the motion than they seem to."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from omniservo.errors import InputError
from omniservo.estimation import estimate_two_view
from omniservo.estimation.uncertainty.shared_errors import SHARED, shared_error_factor

SIGMA = 0.03
WINDOW = 9.0


def correlation(pixels, windows):
    """Of the windows' overlap, written down once more."""
    apart = np.linalg.norm(pixels[:, None] - pixels[None], axis=2)
    square = windows[:, None] ** 2 + windows[None] ** 2
    overlap = SHARED * 2.0 * np.outer(windows, windows) / square * np.exp(-0.5 * apart**2 / square)
    np.fill_diagonal(overlap, 1.0)
    return overlap


def surface(make_view, camera, rng, method):
    """80 points of a hilly or flat surface, near to each other in the image, whose motion is unique."""
    while True:
        x, y = rng.uniform(-0.1, 0.1, (2, 80))
        hills = 0.1 * np.sin(30.0 * x) * np.cos(30.0 * y) if method == "pixel" else 0.0
        direction = rng.standard_normal(3)
        turn = Rotation.from_rotvec(0.2 * rng.standard_normal(3))
        points = np.column_stack((x, y, 0.5 + 0.4 * x + hills))
        try:
            scene = make_view(camera, points, turn, 0.2 * direction / np.linalg.norm(direction))
        except AssertionError:  # a point that the camera does not see
            continue
        if estimate_two_view(camera, scene.pixels_initial, scene.pixels_goal, method=method).status == "ok":
            return scene


@pytest.mark.slow
@pytest.mark.parametrize(("method", "times"), [("pixel", 100), ("homography", 120)])  # which takes longer
def test_the_ellipsoid_is_right_for_errors_that_neighbours_share(make_view, fisheye, method, times):
    rng = np.random.default_rng(71)
    scene = surface(make_view, fisheye, rng, method)
    direction = scene.translation / np.linalg.norm(scene.translation)
    windows = np.full(len(scene.points), WINDOW)
    half = SIGMA * np.linalg.cholesky(correlation(scene.pixels_initial, windows))
    basis = np.zeros((6, 5))
    basis[:3, :2], basis[3:, 2:] = np.linalg.svd(direction[None])[2][1:].T, np.eye(3)
    squares = {True: [], False: []}
    for _ in range(times):
        pixels = [p + half @ rng.standard_normal(p.shape) for p in (scene.pixels_initial, scene.pixels_goal)]
        for known, found in squares.items():
            estimate = estimate_two_view(
                fisheye, *pixels, noise=SIGMA, method=method, robust=False, windows=windows if known else None
            )
            pose = estimate.initial_T_goal
            turn = (scene.rotation.inv() * pose.rotation).as_rotvec()
            error = basis.T @ np.concatenate((pose.translation - direction, turn))
            found.append(error @ np.linalg.solve(basis.T @ estimate.covariance @ basis, error) / 5.0)
    assert 0.8 < np.mean(squares[True]) < 1.25
    assert np.mean(squares[False]) > 1.35


def test_the_factor_is_that_of_the_whole_correlation_matrix():
    rng = np.random.default_rng(72)
    response = rng.standard_normal((30, 6, 4))
    pixels, windows = 40.0 * rng.uniform(size=(30, 4)), rng.uniform(2.0, 12.0, 30)
    flat = response.transpose(1, 0, 2)
    alone = np.einsum("ajc,bjc->ab", flat, flat)
    joint = np.einsum("ajc,jk,bkc->ab", flat, correlation(pixels[:, :2], windows), flat)
    expected = np.trace(np.linalg.solve(alone, joint)) / 6.0
    assert shared_error_factor(response, pixels, windows) == pytest.approx(expected, rel=1e-3)


def test_windows_that_do_not_meet_change_nothing_and_a_point_alone_keeps_its_own_error(make_scene):
    scene = make_scene(np.random.default_rng(73), n=40)
    pixels = scene.noisy(np.random.default_rng(74), SIGMA)
    apart = estimate_two_view(scene.camera, *pixels, noise=SIGMA, windows=np.full(40, 1e-3))
    plain = estimate_two_view(scene.camera, *pixels, noise=SIGMA)
    wide = estimate_two_view(scene.camera, *pixels, noise=SIGMA, windows=np.full(40, 30.0))
    np.testing.assert_allclose(apart.covariance, plain.covariance, rtol=1e-9)
    assert np.trace(wide.covariance) > 1.5 * np.trace(plain.covariance)
    np.testing.assert_array_equal(wide.uncertainty.own, plain.uncertainty.own)
    np.testing.assert_array_equal(wide.points, plain.points)


@pytest.mark.parametrize(
    ("windows", "message"),
    [
        (np.ones(8), "windows: 8 numbers given; 9 are needed"),
        (np.zeros(9), "windows: 0 given; legal: > 0"),
        (np.full(9, np.nan), "windows"),
        (np.ones((9, 2)), "windows"),
    ],
)
def test_illegal_windows_say_what_is_legal(make_scene, windows, message):
    scene = make_scene(np.random.default_rng(75))
    with pytest.raises(InputError, match=message):
        estimate_two_view(scene.camera, scene.pixels_initial, scene.pixels_goal, windows=windows)
