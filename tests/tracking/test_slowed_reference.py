"""A tracker whose reference slows down, rests and goes on: no jump, no more room than was given."""

import numpy as np
import pytest
from kinematic_loop import FISHEYE, FRONT, Loop, bent_path, plan_of

from omniservo.errors import FeatureLoss, InputError
from omniservo.planning import CameraPath
from omniservo.servoing import RestToRestLaw
from omniservo.tracking import Leg, PathTracker
from omniservo.tracking.reference import Reference

PATH = CameraPath(*bent_path().powers)
LAW = RestToRestLaw(4.0)


def reference():
    return Reference(Leg(PATH, LAW))


def followed(until):
    """A tracker that has followed its path so far, and where the camera then is."""
    loop = Loop(FISHEYE)
    tracker = PathTracker(plan_of(), FISHEYE, time_law=LAW)
    loop.run(tracker, bent_path(), until)
    return tracker, loop


def test_it_comes_to_rest_on_the_way_and_goes_on_from_there_without_a_jump():
    way = reference()
    assert way.slow_down(1.5, 0.4) == pytest.approx(1.9)
    assert way.slow_down(1.7, 0.1) == pytest.approx(1.9)  # it does already
    np.testing.assert_array_equal(way.pose(1.9), way.pose(7.0))
    assert not way.state(3.0)[3].any()
    way.go_on(5.0, 0.5)
    times = np.linspace(0.0, 12.0, 6001)
    poses = np.array([way.pose(t) for t in times])
    speeds = np.array([way.state(t)[3] for t in times])
    assert np.abs(np.diff(poses, axis=0)).max() < 1e-3
    assert np.abs(np.diff(speeds, axis=0)).max() < 3e-3
    np.testing.assert_allclose(poses[-1], reference().pose(4.0), atol=1e-12)
    np.testing.assert_array_equal(way.pose(1.5), reference().pose(1.5))


def test_it_can_go_on_before_it_began_to_slow_down():
    way = reference()
    way.slow_down(1.5, 0.4)
    way.go_on(1.4, 0.5)
    for time in (1.3, 1.5, 2.5):
        np.testing.assert_allclose(way.pose(time), reference().pose(time), atol=1e-12)


def test_how_far_off_the_path_it_may_be_counts_from_where_it_was_seen():
    tracker, _ = followed(1.5)
    seen = tracker.legs[0].path(LAW(tracker.report.time)[0]).translation
    off = np.linalg.norm(tracker.report.filtered_pose[4:] - seen)
    rest = tracker.legs[0].path(LAW(1.8)[0]).translation
    assert tracker.off_path(1.7, 0.2) == pytest.approx(off + np.linalg.norm(rest - seen), rel=1e-6)
    assert PathTracker(plan_of(), FISHEYE, time_law=LAW).off_path(1.0, 0.2) == 0.0


def test_a_leg_that_is_still_to_come_is_entered_later_at_the_same_place():
    way = reference()
    rest = PATH.part(LAW(2.0)[0], 1.0)
    begin = LAW(2.0)[0]

    class Rest:
        def __call__(self, time):
            w, speed = LAW(max(time, 2.0))
            return (w - begin) / (1.0 - begin), speed / (1.0 - begin)

        def finished(self, time):
            return LAW.finished(time)

    way.legs.append(way.joined(Leg(rest, Rest(), 2.0, begin)))
    way.slow_down(1.9, 0.1)
    assert way.legs[1].time == np.inf
    assert len({id(way.leg(t)) for t in (1.9, 5.0, 50.0)}) == 1
    way.go_on(3.0, 0.2)
    entered = way.legs[1].time
    assert 3.0 < entered < 3.2
    near = [way.state(entered + step) for step in (-1e-6, 1e-6)]
    for before, after in zip(near[0], near[1], strict=True):
        np.testing.assert_allclose(before, after, atol=1e-5)
    assert way.state(9.0)[0] == pytest.approx(1.0)


def test_no_leg_is_taken_up_while_it_rests():
    tracker, _ = followed(1.0)
    tracker.slow_down(1.0, 0.1)
    with pytest.raises(InputError, match="slowed down"):
        tracker.take_up(Leg(PATH, LAW, 1.5))


def test_where_it_was_not_slowed_down_going_on_is_nothing():
    tracker, _ = followed(0.5)
    before = tracker.legs
    tracker.go_on(1.0, 0.3)
    assert tracker.legs == before


def test_it_coasts_by_what_carries_it_as_it_steps_by_an_image():
    tracker, loop = followed(1.5)
    last = tracker.report.time
    pose = loop.pose

    def where(time):
        moved = pose if time > last else loop_at_last
        return np.concatenate((moved.rotation.as_quat(), moved.translation))

    loop_at_last = tracker.report.initial_T_camera
    tracker.carried_by(where)
    twist = tracker.coast(1.5, 1.5)
    report = tracker.report
    np.testing.assert_allclose(tracker.step(1.5, loop.look()), twist, atol=1e-4)
    assert report.time == last  # nothing was learnt by coasting


def test_it_returns_to_the_path_where_it_was_moved_off_it():
    tracker, _ = followed(1.5)
    rest = tracker.slow_down(1.5, 0.01)
    last, aside = tracker.report, np.array([0.0, 0.004, 0.0])

    def where(time):
        # By the joints the camera is beside where the reference rests.
        if time <= last.time:
            return last.filtered_pose
        there = tracker.legs[0].path(tracker.legs[0].w(rest)[0])
        return np.concatenate((there.rotation.as_quat(), there.translation + there.rotation.apply(aside)))

    tracker.carried_by(where)
    back = tracker.coast(rest + 1.0, rest + 1.0)
    np.testing.assert_allclose(back[:3], -3.0 * aside, atol=2e-3)


def test_there_is_nothing_to_coast_on_before_the_first_image():
    tracker = PathTracker(plan_of(FRONT), FISHEYE, time_law=LAW)
    with pytest.raises(FeatureLoss, match="no image"):
        tracker.coast(0.1, 0.1)


def test_of_a_way_that_was_left_counts_what_was_before():
    way, left = reference(), 2.0
    end = LAW(left)[0]
    rest = CameraPath(*bent_path(bend=(-0.15, 0.0, 0.0)).powers)
    way.legs.append(Leg(rest, LAW, left))
    on_both, beyond = PATH(0.6 * end).translation, PATH(0.5 * (1.0 + end)).translation
    assert way.distance(on_both) < 1e-5
    assert way.distance(rest(0.7).translation) < 1e-5
    assert way.distance(beyond) > 0.01
    way.slow_down(left - 0.1, 0.1)  # it rests before the other way is entered
    assert way.legs[1].time == np.inf
    assert way.distance(on_both) < 1e-5
    assert way.distance(beyond) > 0.01
