"""A jump of all points in a fast motion is told by the image after it; one odd image alone is no jump."""

import numpy as np
import pytest
from scipy.spatial.transform import RigidTransform

pytest.importorskip("benchmarks.free_camera", reason="benchmarks/ is not part of this copy")

from benchmarks.free_camera import FreeBody

from omniservo.cameras import preset
from omniservo.errors import InconsistentImage
from omniservo.robots import RobotState
from omniservo.safety import SafetyOptions
from omniservo.safety.image_watch import ImageWatch
from omniservo.safety.motion_history import MotionHistory
from omniservo.safety.seen_points import SeenPoints

PAN = np.array([0.0, 0.0, 0.0, 0.0, 1.25, 0.0])
"""[rad/s], by which points move some 17 px from image to image"""
PASS = np.array([0.65, 0.0, 0.0, 0.0, 0.0, 0.0])
"""[m/s], likewise 15 px"""
CAMERA = preset("perspective")
POINTS = np.array([0.0, 0.0, 0.6]) + np.random.default_rng(0).uniform(-0.12, 0.12, (20, 3))
RATE, BEGIN, FAULT, END = 30, 8, 16, 22
"""images a second; the first that moves, the first that is wrong, the last"""


def told(moving, off, *, late=0.0, taken_for=1.0):
    """The number of the image that was inconsistent; None: none was.

    Points are ``off(number)`` px, stamps from `FAULT` on ``late`` s, distances taken for a multiple.
    """
    random, body, rest = np.random.default_rng(1), FreeBody(), np.zeros(6)
    history = MotionHistory(RobotState(0.0, rest, rest), body.joint_acceleration)
    watch = ImageWatch(CAMERA, body, RigidTransform.identity(), SafetyOptions())
    for k in range(END):
        for tick in range(1, 8):
            time = (k + tick / 7.0) / RATE
            joints = moving * max(time - BEGIN / RATE, 0.0)
            history.measured(RobotState(time, joints, moving))
        pose = body.base_T_flange(joints)
        pixels, valid = CAMERA.project(pose.inv().apply(POINTS))
        assert valid.all()
        seen = pixels + 0.5 * random.standard_normal(pixels.shape) + off(k)
        stamp = time + late * (k >= FAULT)
        try:
            watch.check(SeenPoints(stamp, seen, valid, taken_for * POINTS, pose), history)
        except InconsistentImage:
            return k
    return None


def lasting(by):
    return lambda k: np.array(by) * (k >= FAULT)


def single(by):
    return lambda k: np.array(by) * (k == FAULT)


@pytest.mark.parametrize("by", [(20.0, 0.0), (-20.0, 0.0), (-14.0, 14.0), (0.0, -20.0)])
def test_a_jump_in_a_fast_motion_is_told_by_the_next_image(by):
    assert told(PAN, lasting(by)) == FAULT + 1


@pytest.mark.parametrize("px", [-40.0, -20.0, -8.0, 8.0, 12.0, 20.0, 40.0])
@pytest.mark.parametrize(("moving", "taken_for"), [(PAN, 1.0), (PASS, 1.3), (PASS, 0.75)])
def test_a_single_odd_image_in_a_fast_motion_is_no_jump_whatever_the_distances_are(px, moving, taken_for):
    """One way an image may be off and not odd, and the next one odd."""
    assert told(moving, single((px, 0.0)), taken_for=taken_for) is None


def test_without_a_look_at_the_next_image_the_jump_is_taken_for_the_motion(monkeypatch):
    monkeypatch.setattr(ImageWatch, "_lasts", lambda *args: False)
    assert told(PAN, lasting((0.0, -20.0))) is None


@pytest.mark.parametrize("late", [-0.01, 0.01])
def test_time_stamps_that_step_by_less_than_they_may_are_no_jump(late):
    assert told(PAN, single((0.0, 0.0)), late=late) is None


def test_a_jump_within_what_time_stamps_make_of_the_motion_is_not_told():
    """Where points move by 17 px from image to image, 22 ms are 11 px, and 4 px are free."""
    assert told(PAN, lasting((12.0, 0.0))) is None
