"""A delay that was stated wrongly does not matter to a tracker that is told the measured one."""

import numpy as np
import pytest
from kinematic_loop import FISHEYE, FRONT, bent_path, plan_of

from omniservo.errors import InputError
from omniservo.safety import VisibilityFilter
from omniservo.safety.measured_delays import MeasuredDelays
from omniservo.tracking import PathTracker, TrackerOptions


def test_delays_are_those_of_the_last_images():
    delays = MeasuredDelays(0.01, 0.25)
    for k in range(20):
        delays.seen(0.1 * k, 0.1 * k + 0.06)
        delays.commanded(0.1 * k + 0.065)
    delays.seen(2.0, 2.09)  # this image is later
    assert delays.first == pytest.approx(0.09 + 0.005 + 0.01)
    assert delays.mean == pytest.approx(delays.first + 0.05)


def test_what_lies_between_images_round_a_gap_is_no_period():
    delays = MeasuredDelays(0.0, 0.25)
    assert np.isnan(delays.period)
    delays.seen(0.0, 0.0)
    delays.seen(2.0, 2.0)
    assert np.isnan(delays.period)
    delays.seen(2.1, 2.1)
    assert delays.period == pytest.approx(0.1)


def test_the_first_image_has_no_period_and_an_image_of_the_future_no_negative_delay():
    delays = MeasuredDelays(0.0, 0.25)
    delays.seen(1.0, 1.02)
    assert delays.first == delays.mean == pytest.approx(0.02)
    delays.seen(2.0, 1.9)
    assert delays.first == 0.0


def test_one_late_image_does_not_change_what_computing_takes():
    delays = MeasuredDelays(0.0, 0.25)
    for k in range(9):
        delays.seen(0.1 * k, 0.1 * k)
        delays.commanded(0.1 * k + (0.5 if k == 5 else 0.004))
    assert delays.first == pytest.approx(0.004)


def twist_of(stated, acts_at):
    tracker = PathTracker(plan_of(FRONT, bent_path()), FISHEYE, options=TrackerOptions(delay=stated))
    pixels, seen = FISHEYE.project(bent_path()(0.45).inv().apply(FRONT))
    return tracker.step(1.9, pixels, seen, acts_at)


def test_what_is_measured_counts_and_not_what_is_stated():
    told = twist_of(0.1, None)
    np.testing.assert_array_equal(twist_of(0.0, 2.0), told)
    assert np.abs(twist_of(0.0, None) - told).max() > 1e-3
    with pytest.raises(InputError, match="acts_at"):
        twist_of(0.0, np.nan)


def test_the_filter_too_goes_by_the_measured_delay():
    edge = np.array([[535.0, 255.0]])  # the lens sees to 554 px
    bearing, _ = FISHEYE.unproject(edge)
    twist = np.array([0.0, 0.3, 0.0, 0.0, -1.0, 0.0])

    def heights(stated, measured):
        keeper = VisibilityFilter(FISHEYE, delay=stated)
        steps = [keeper.step(bearing, edge, np.ones(1, dtype=bool), twist, measured) for _ in range(2)]
        return [step.least_height_px for step in steps]

    assert heights(0.0, 0.1) == heights(0.1, None) == heights(0.1, 0.1)
    assert heights(0.0, None)[1] != heights(0.0, 0.1)[1]
    with pytest.raises(InputError, match="delay"):
        heights(0.0, -1.0)


def test_the_filter_carries_points_on_as_the_camera_moves_and_not_by_what_it_was_commanded_last():
    edge = np.array([[535.0, 255.0]])
    bearing, _ = FISHEYE.unproject(edge)
    twist = np.array([0.0, 0.3, 0.0, 0.0, -1.0, 0.0])
    seen = np.ones(1, dtype=bool)
    keeper = VisibilityFilter(FISHEYE)
    first = keeper.step(bearing, edge, seen, twist, 0.1)
    by_last = keeper.step(bearing, edge, seen, twist, 0.1)
    by_joints = keeper.step(bearing, edge, seen, twist, 0.1, np.zeros(6))  # they stood
    assert by_joints.least_height_px == first.least_height_px
    assert by_joints.least_height_px > by_last.least_height_px + 1.0
    again = keeper.step(bearing, edge, seen, twist, 0.1, first.twist)
    assert again.least_height_px == pytest.approx(by_last.least_height_px, abs=1e-9)
    with pytest.raises(InputError, match="carried"):
        keeper.step(bearing, edge, seen, twist, 0.1, np.zeros(5))
