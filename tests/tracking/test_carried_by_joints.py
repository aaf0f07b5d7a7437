"""What was seen is carried on by what the joints did, where that is not what was planned or commanded."""

import numpy as np
import pytest
from kinematic_loop import FISHEYE, FRONT, Loop, bent_path, plan_of
from scipy.spatial.transform import RigidTransform, Rotation

from omniservo.errors import InputError
from omniservo.servoing import RestToRestLaw
from omniservo.tracking import GoalServo, PathTracker, TrackerOptions

LAW = RestToRestLaw(4.0)
GAIN = 3.0
ELSEWHERE = RigidTransform.from_components([0.4, -0.3, 0.9], Rotation.from_rotvec([0.5, 1.0, -0.4]))
"""the frame in which the joints have the camera"""


def row(pose):
    return np.concatenate((pose.rotation.as_quat(), pose.translation))


class Joints:
    """Where the joints have the camera, as a function of time; after ``until`` they would be wrong."""

    def __init__(self, pose, until=np.inf):
        self._pose, self.until = pose, until

    def __call__(self, time):
        assert time <= self.until + 1e-12
        return row(ELSEWHERE * self._pose(time))


def planned(time):
    return bent_path()(LAW(time)[0])


def half(time):
    """From 1.5 s on at half of the planned pace."""
    return planned(min(time, 1.5) + 0.5 * max(time - 1.5, 0.0))


def standing(time):
    return planned(min(time, 1.5))


def at(time, joints=None, delay=0.0):
    """A tracker that has seen one image, at 1.5 s and where it was planned, and that one's twist."""
    tracker = PathTracker(plan_of(), FISHEYE, options=TrackerOptions(gain=GAIN), time_law=LAW)
    if joints is not None:
        tracker.carried_by(joints)
    pixels, seen = FISHEYE.project(planned(time).inv().apply(FRONT))
    return tracker, tracker.step(time, pixels, seen, time + delay)


@pytest.mark.parametrize("did", [planned, half, standing])
def test_points_are_predicted_where_the_joints_have_the_camera(did):
    tracker, _ = at(1.5, Joints(did))
    there, _ = FISHEYE.project(did(1.7).inv().apply(FRONT))
    np.testing.assert_allclose(tracker.predict(1.7)[0], there, atol=1e-3)
    by_plan, _ = at(1.5)[0].predict(1.7)
    assert (np.abs(by_plan - there).max() < 1e-3) == (did is planned)


@pytest.mark.parametrize("did", [half, standing])
def test_the_filter_joins_an_image_with_the_prediction_of_the_joints(did):
    rng = np.random.default_rng(4)
    off = {True: [], False: []}
    for _ in range(20):
        pixels, seen = FISHEYE.project(did(1.7).inv().apply(FRONT))
        pixels = pixels + 1.0 * rng.standard_normal(pixels.shape)
        for measured in (True, False):
            tracker, _ = at(1.5, Joints(did) if measured else None)
            tracker.step(1.7, pixels, seen)
            off[measured].append(np.linalg.norm(tracker.report.filtered_pose[4:] - did(1.7).translation))
    assert np.mean(off[True]) < 0.7 * np.mean(off[False])


def test_joints_that_do_what_was_planned_change_no_twist():
    _, twist = at(1.5, Joints(planned), 0.1)
    np.testing.assert_allclose(twist, at(1.5, None, 0.1)[1], atol=1e-6)


def twist_seen_from(pose, time):
    """Of an image that was taken just when its twist acts."""
    tracker = PathTracker(plan_of(), FISHEYE, options=TrackerOptions(gain=GAIN), time_law=LAW)
    pixels, seen = FISHEYE.project(pose.inv().apply(FRONT))
    return tracker.step(time, pixels, seen, time)


@pytest.mark.parametrize("did", [half, standing])
def test_a_twist_is_that_for_where_the_joints_bring_the_camera_until_it_acts(did):
    _, twist = at(1.5, Joints(did), 0.1)
    np.testing.assert_allclose(twist, twist_seen_from(did(1.6), 1.6), atol=1e-5)
    assert np.abs(twist - at(1.5, None, 0.1)[1]).max() > 5e-3


def test_what_is_not_sent_yet_is_as_planned():
    known = 1.53
    _, twist = at(1.5, Joints(standing, until=known), 0.1)
    then = standing(known) * planned(known).inv() * planned(1.6)
    np.testing.assert_allclose(twist, twist_seen_from(then, 1.6), atol=1e-5)
    assert np.abs(twist - twist_seen_from(standing(1.6), 1.6)).max() > 5e-3


def test_a_reading_that_is_older_than_the_image_carries_nothing():
    joints = Joints(half)
    joints.until = 1.4
    joints.__class__ = type("Backwards", (Joints,), {"__call__": lambda self, time: row(half(time + 0.05))})
    np.testing.assert_allclose(at(1.5, joints, 0.1)[1], at(1.5, None, 0.1)[1], atol=1e-6)


@pytest.mark.parametrize("did", [half, standing])
def test_a_servo_without_a_path_predicts_by_the_joints_too(did):
    goal, _ = FISHEYE.project(planned(4.0).inv().apply(FRONT))
    servo = GoalServo(FISHEYE, FRONT, goal)
    servo.carried_by(Joints(did))
    pixels, seen = FISHEYE.project(did(1.5).inv().apply(FRONT))
    servo.step(1.5, pixels, seen)
    there, _ = FISHEYE.project(did(1.8).inv().apply(FRONT))
    np.testing.assert_allclose(servo.predict(1.8)[0], there, atol=1e-3)


def test_an_uncertain_stamp_lets_an_image_count_less_the_faster_the_camera_moves():
    def weight(time, sigma):
        tracker, _ = at(time)
        pixels, seen = FISHEYE.project(planned(time + 0.03).inv().apply(FRONT))
        rng = np.random.default_rng(1)
        pixels = pixels + 0.1 * rng.standard_normal(pixels.shape)
        tracker.step(time + 0.033, pixels, seen, time_sigma=sigma)
        return np.trace(tracker.report.filtered_covariance[:3, :3])

    assert weight(2.0, 0.01) > 1.05 * weight(2.0, 0.0)
    assert weight(0.0, 0.01) == pytest.approx(weight(0.0, 0.0), rel=1e-3)  # at rest a stamp does not matter
    with pytest.raises(InputError, match="time_sigma"):
        weight(2.0, -1.0)


def test_of_two_poses_the_one_with_the_uncertain_stamp_moves_the_estimate_less_along_the_motion():
    def filtered(sigma):
        loop = Loop(FISHEYE, pose=planned(1.5))
        tracker, _ = at(1.5)
        loop.pose = planned(1.54)  # stamped 1.533
        tracker.step(1.533, loop.look() + 0.1, None, time_sigma=sigma)
        return np.linalg.norm(tracker.report.filtered_pose[4:] - planned(1.533).translation)

    assert filtered(0.01) < 0.8 * filtered(0.0)
