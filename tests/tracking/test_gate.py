"""Wrong features in the closed loop: things that look alike, where the pose of the others has none."""

import numpy as np
import pytest
from kinematic_loop import FISHEYE, FRONT, Loop, bent_path, plan_of, ring

from omniservo.errors import FeatureLoss
from omniservo.tracking import PathTracker, TrackerOptions

MANY = np.concatenate((FRONT, FRONT + np.array([0.02, 0.03, 0.05]), 0.9 * FRONT))[:20]


def run_with_wrong_points(points, wrong, shift, seconds=6.0, noise=0.05):
    path, period = bent_path(), 0.02
    loop = Loop(FISHEYE, points=points, noise=noise, period=period)
    # The predicted place and a steady offset: what a tracker reports that has caught a neighbour.
    look = loop.look

    def disturbed():
        pixels = look()
        pixels[wrong] += shift
        return pixels

    loop.look = disturbed
    tracker = PathTracker(plan_of(points, path), FISHEYE, options=TrackerOptions(delay=0.5 * period))
    loop.run(tracker, path, seconds)
    return tracker, loop


@pytest.mark.parametrize(
    ("points", "wrong"), [(FRONT, [4]), (FRONT, [0, 7]), (MANY, [1, 5, 10, 15])], ids=["1/9", "2/9", "4/20"]
)
def test_wrong_points_are_left_out_and_the_camera_stays_on_the_path(points, wrong):
    tracker, loop = run_with_wrong_points(points, wrong, np.array([7.0, -5.0]))
    assert not tracker.report.used[wrong].any()
    assert tracker.report.valid_count == len(points) - len(wrong)
    assert max(loop.deviations) < 1e-3
    assert tracker.done


def test_no_point_is_rejected_for_noise_alone():
    tracker, loop = run_with_wrong_points(FRONT, [], 0.0, seconds=3.0, noise=0.5)
    assert tracker.report.valid_count == 9
    assert max(loop.deviations) < 6e-3


def test_a_point_that_comes_back_to_its_place_is_used_again():
    path = bent_path()
    tracker = PathTracker(plan_of(FRONT, path), FISHEYE)
    for k, shift in enumerate((0.0, 9.0, 9.0, 0.0)):
        pixels = Loop(FISHEYE, points=FRONT, pose=path(tracker.time_law(0.03 * k)[0])).look()
        pixels[3, 0] += shift
        tracker.step(0.03 * k, pixels)
        assert tracker.report.used[3] == (shift == 0.0)


def test_a_point_beyond_the_rim_of_the_lens_cannot_be_where_something_is_seen():
    points = ring([30, 40, 50, 60, 70, 93.0])  # the lens sees 92.5°, and the camera turns towards the last
    path = bent_path((0.01, 0.02, 0.01), (0.173, 0.1, 0.0), (0.0, 0.0, 0.0))
    seen = FISHEYE.project(points[:-1])[0]
    tracker = PathTracker(plan_of(points, path), FISHEYE)
    twist = tracker.step(0.0, np.vstack((seen, FISHEYE.project([0.5, -0.7, 0.1])[0])))
    assert tracker.report.used.tolist() == [True] * 5 + [False]
    assert np.abs(twist).max() < 1e-6
    assert np.sqrt(np.diag(tracker.report.filtered_covariance)).max() < 2e-3


def test_too_few_points_that_agree_stop_the_servo():
    path = bent_path()
    points = ring([30, 40, 50, 35, 45])
    tracker = PathTracker(plan_of(points, path), FISHEYE, options=TrackerOptions(least_features=5))
    pixels = Loop(FISHEYE, points=points).look()
    pixels[2] += [0.0, 12.0]
    with pytest.raises(FeatureLoss, match="4 of 5"):
        tracker.step(0.0, pixels)
