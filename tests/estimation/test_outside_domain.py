"""A pixel that the camera cannot have seen is a wrong match, not an error of the whole call."""

import numpy as np
import pytest
from scipy.spatial.transform import RigidTransform, Rotation

from omniservo.cameras import preset
from omniservo.errors import InputError
from omniservo.estimation import estimate_pose, estimate_two_view, estimate_views
from omniservo.estimation.estimate_known_target import estimate_known_target

CAMERA = preset("fe185")
FAR = np.array([5000.0, 0.0])
MOTION = RigidTransform.from_components([0.3, -0.1, 0.1], Rotation.from_rotvec([0.1, -0.2, 0.05]))


def scene(n=30):
    """Points half a metre ahead, and their pixels in both images, to a tenth of a pixel."""
    rng = np.random.default_rng(0)
    points = rng.uniform([-0.5, -0.5, 0.4], [0.5, 0.5, 1.2], (n, 3))
    seen = [CAMERA.project(pose.apply(points))[0] for pose in (RigidTransform.identity(), MOTION.inv())]
    return points, *(pixels + rng.normal(0.0, 0.1, pixels.shape) for pixels in seen)


@pytest.mark.parametrize("method", ["pixel", "homography"])
def test_two_views_leave_it_out_and_answer_as_without_it(method):
    points, initial, goal = scene()
    if method == "homography":
        points[:, 2] = 0.8
        initial, goal = (
            CAMERA.project(pose.apply(points))[0] for pose in (MOTION.inv() * MOTION, MOTION.inv())
        )
    goal[7] = FAR
    noise, rest = np.full((30, 2), 0.1), np.delete(np.arange(30), 7)
    options = {"scale": ((3, 20), 0.5), "windows": np.full(30, 4.0)}
    found = estimate_two_view(CAMERA, initial, goal, noise=noise, method=method, **options)
    without = estimate_two_view(
        CAMERA, initial[rest], goal[rest], noise=noise[rest], method=method, scale=((3, 19), 0.5),
        windows=np.full(29, 4.0),
    )  # fmt: skip
    assert found.status == without.status == "ok"
    assert not found.inliers[7]
    np.testing.assert_array_equal(found.inliers[rest], without.inliers)
    np.testing.assert_allclose(found.points[rest], without.points)
    np.testing.assert_allclose(found.covariance, without.covariance)
    np.testing.assert_allclose(found.points_covariance[rest], without.points_covariance)
    assert np.isnan(found.residuals_px[7]).all()
    assert np.isfinite(found.sample(np.random.default_rng(0), 3).points[:, found.inliers]).all()


def test_a_square_with_such_a_corner_is_none():
    _, initial, goal = scene()
    goal[1] = FAR
    squares = np.arange(8).reshape(2, 4)
    found = estimate_two_view(CAMERA, initial, goal, noise=0.1, squares=squares)
    assert found.inliers.shape == (30,)
    assert not found.inliers[1]


def test_a_scale_that_refers_to_it_is_lost_with_it():
    _, initial, goal = scene()
    initial[3] = FAR
    found = estimate_two_view(CAMERA, initial, goal, scale=((3, 20), 0.5))
    assert found.status == "not_converged"
    assert found.message == "point 3, which the scale refers to, is outside the camera's domain"


def test_poses_and_known_targets_leave_it_out_too():
    points, initial, goal = scene()
    plain = estimate_pose(CAMERA, np.delete(points, 4, 0), np.delete(initial, 4, 0), noise=0.1)
    initial[4] = FAR
    pose = estimate_pose(CAMERA, points, initial, noise=np.full(30, 0.1))
    np.testing.assert_allclose(pose.covariance, plain.covariance)
    assert not pose.inliers[4]
    assert np.isnan(pose.residuals_px[4]).all()
    visible = np.ones((2, 30), dtype=bool)
    target = estimate_known_target(CAMERA, points, initial, goal, visible=visible, noise=0.1)
    assert target.status == "ok"
    assert not target.inliers[4]
    assert visible.all()


def test_several_views_leave_it_out_too():
    _, initial, goal = scene()
    initial[4] = FAR
    found = estimate_views(CAMERA, np.stack([initial, goal]), scale=0.3)
    assert found.status == "ok"


def test_the_noise_of_the_few_that_are_left_is_assumed_as_of_so_few():
    """Of five left no residual told it (a ZeroDivisionError), of seven two: an answer that was too sure."""
    for out, seed in ((2, 1), (4, 21)):
        rng = np.random.default_rng(seed)
        points = rng.uniform([-1.0, -1.0, 1.0], [1.0, 1.0, 3.0], (9, 3))
        initial, goal = (CAMERA.project(p)[0] for p in (points, points - [0.4, 0.1, 0.2]))
        initial += 0.05 * rng.normal(size=initial.shape)
        alone = estimate_two_view(CAMERA, initial[out:], goal[out:])
        initial[:out] = FAR
        found = estimate_two_view(CAMERA, initial, goal)
        assert found.status == alone.status == "ok"
        np.testing.assert_array_equal(found.covariance, alone.covariance)


def test_most_outside_or_no_leaving_out_is_an_error_that_names_the_first():
    points, initial, goal = scene()
    goal[7] = FAR
    with pytest.raises(
        InputError, match=r"pixels_goal: \(5000, 0\) at index 7 is outside the camera's domain"
    ):
        estimate_two_view(CAMERA, initial, goal, robust=False)
    with pytest.raises(InputError, match="at index 7 is outside"):
        estimate_pose(CAMERA, points, goal, robust=False)
    goal[7:] = FAR
    for call in (estimate_two_view, estimate_pose):
        with pytest.raises(InputError, match="at index 7 is outside"):
            call(CAMERA, points if call is estimate_pose else initial, goal)


def repeated(rows, n=30):
    """Places of n matches, of which ``rows`` stand three times more, shuffled."""
    return np.random.default_rng(1).permutation(np.concatenate((np.arange(n), np.repeat(rows, 3))))


@pytest.mark.parametrize("noise", [None, 0.1])
def test_equal_matches_count_once(noise):
    _, initial, goal = scene()
    places = repeated([2, 5, 7])
    first = np.array([np.flatnonzero(places == k)[0] for k in range(30)])
    once = np.sort(first)
    without = estimate_two_view(CAMERA, initial[places[once]], goal[places[once]], noise=noise)
    found = estimate_two_view(CAMERA, initial[places], goal[places], noise=noise)
    assert found.status == without.status == "ok"
    np.testing.assert_array_equal(np.flatnonzero(found.inliers), once)
    np.testing.assert_allclose(found.covariance, without.covariance)
    np.testing.assert_allclose(found.points[once], without.points)


def test_eight_matches_of_which_five_are_different_ones_are_not_sure():
    _, initial, goal = scene()
    rows = [0, 1, 2, 3, 4, 0, 0, 1]
    found = estimate_two_view(CAMERA, initial[rows], goal[rows])
    five = estimate_two_view(CAMERA, initial[:5], goal[:5])
    assert (found.status, found.message) == (five.status, five.message)


def test_a_scale_or_a_square_of_a_repeated_match_is_that_of_the_first():
    _, initial, goal = scene()
    places = np.concatenate((np.arange(30), [3, 20, 8, 9, 10, 11]))
    squares = [[8, 9, 10, 11]]
    want = estimate_two_view(CAMERA, initial, goal, noise=0.1, scale=((3, 20), 0.5))
    found = estimate_two_view(CAMERA, initial[places], goal[places], noise=0.1, scale=((30, 31), 0.5))
    np.testing.assert_allclose(found.initial_T_goal.as_matrix(), want.initial_T_goal.as_matrix())
    want = estimate_two_view(CAMERA, initial, goal, noise=0.1, squares=squares)
    both = [*squares, [32, 33, 34, 35]]
    found = estimate_two_view(CAMERA, initial[places], goal[places], noise=0.1, squares=both)
    np.testing.assert_array_equal(found.inliers[:30], want.inliers)
    assert found.status == want.status


def test_a_scale_between_equal_matches_is_refused():
    _, initial, goal = scene()
    places = [*range(30), 3]
    with pytest.raises(InputError, match="points 3 and 30 have the same pixels"):
        estimate_two_view(CAMERA, initial[places], goal[places], noise=0.1, scale=((3, 30), 0.5))
