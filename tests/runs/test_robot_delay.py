"""The parts of finding a robot's delay that need no wall clock: tracked points, and the drives' lag."""

from types import SimpleNamespace

import cv2
import numpy as np
import pytest
from scipy.spatial.transform import RigidTransform

from omniservo.errors import NoSolutionError
from omniservo.hardware import JointHistory
from omniservo.robots import RobotState, load_arm
from omniservo.runs.robot_delay import (
    SECONDS,
    DelayRecording,
    actuation_lag,
    measure_delay,
    swing,
    swing_barred,
    swing_joints,
    swing_size,
    tracked,
)
from omniservo.safety import SafetyOptions

ARM = load_arm("ur5e")


def moved(shifts, shape=(240, 320)):
    """Images of blurred noise that is shifted by shifts (k, 2) [px]."""
    noise = np.random.default_rng(0).integers(0, 255, shape).astype(np.uint8)
    texture = cv2.GaussianBlur(noise, (0, 0), 2.0)
    texture = cv2.normalize(texture, None, 0, 255, cv2.NORM_MINMAX)
    return [cv2.warpAffine(texture, np.array([[1.0, 0.0, u], [0.0, 1.0, v]]), shape[::-1]) for u, v in shifts]


def test_points_are_tracked_to_a_fraction_of_a_pixel():
    shifts = np.array([[0.0, 0.0], [3.3, -1.2], [9.6, 2.5], [-4.1, 6.2]])
    tracks = tracked(moved(shifts))
    kept = np.isfinite(tracks).all(axis=(0, 2))
    kept &= (np.abs(tracks[0] - [160.0, 120.0]) < [120.0, 80.0]).all(axis=1)  # black comes in at the edges
    assert kept.sum() > 10
    assert np.abs(tracks[:, kept] - tracks[0, kept] - shifts[:, None]).max() < 0.2


def test_a_point_that_is_covered_is_lost_and_not_invented():
    images = moved(np.zeros((3, 2)))
    first = tracked(images)[0]
    covered = images[1].copy()
    u, v = first[0].astype(int)
    covered[max(v - 30, 0) : v + 30, max(u - 30, 0) : u + 30] = 128
    tracks = tracked([images[0], covered, images[2]])
    assert np.isnan(tracks[1, 0]).all()
    assert tracks[2, 0] == pytest.approx(first[0], abs=0.1)


def test_images_without_texture_are_refused():
    with pytest.raises(NoSolutionError, match="no corners"):
        tracked([np.full((50, 50), 90, np.uint8)] * 3)


def swung(lag):
    """Joints swing so late after their commands, each in force until the next; and which joints they are."""
    chosen, rng = swing_joints(ARM), np.random.default_rng(1)
    times = np.arange(0.0, SECONDS, 0.007)
    speeds = np.array([swing(np.zeros(6), chosen, 0.03, time)[1] for time in times])
    read = np.arange(0.1, SECONDS, 0.002)
    late = speeds[np.maximum(np.searchsorted(times, read - lag, side="right") - 1, 0)]
    states = [
        RobotState(float(t), np.zeros(6), v + rng.normal(0.0, 1e-3, 6))
        for t, v in zip(read, late, strict=True)
    ]
    sent = list(zip(times.tolist(), speeds, strict=True))
    return DelayRecording(JointHistory(6, 8.0), states, sent, [], [], [], []), chosen


@pytest.mark.parametrize("lag", [0.012, 0.08])
def test_the_drives_lag_is_found(lag):
    found, sigma = actuation_lag(*swung(lag))
    assert found == pytest.approx(lag, abs=1e-3)
    assert 0.0 < sigma < 1e-3


@pytest.mark.parametrize("lag", [0.31, 0.4])
def test_a_lag_beyond_those_that_are_searched_is_refused_and_not_taken_for_the_longest(lag):
    with pytest.raises(NoSolutionError, match=r"turn 0\.3 s or more after their commands"):
        actuation_lag(*swung(lag))


CLOSE = np.deg2rad([0.0, -90.0, 158.5, -41.9, 179.0, 173.1])
"""Parts of the arm are 3.3 mm apart here, and meet where both joints have swung."""


def test_an_arm_that_would_hit_itself_in_the_swing_does_not_move():
    mount, begin = RigidTransform.identity(), np.deg2rad([0.0, -90.0, 90.0, -90.0, -90.0, 0.0])
    assert swing_barred(ARM, mount, begin) == ""
    assert "range" in swing_barred(ARM, mount, begin + np.deg2rad([0.0, 0.0, 0.0, 0.0, 449.0, 0.0]))
    cell = SimpleNamespace(
        scene=SimpleNamespace(arm=ARM, flange_T_camera=mount),
        driver=SimpleNamespace(read=lambda: RobotState(0.0, CLOSE, np.zeros(6))),
        approve=lambda motion: pytest.fail(f"about to {motion}"),
    )
    with pytest.raises(NoSolutionError, match=r"wrist_1 and wrist_2 have no 2\.0 deg of room .*: wrist"):
        measure_delay(cell, SafetyOptions())


def test_an_arm_that_is_moved_while_the_question_stands_does_not_swing():
    begin, agreed = np.deg2rad([0.0, -90.0, 90.0, -90.0, -90.0, 0.0]), []

    def read():
        return RobotState(0.0, CLOSE if agreed else begin, np.zeros(6))

    cell = SimpleNamespace(
        scene=SimpleNamespace(arm=ARM, flange_T_camera=RigidTransform.identity()),
        driver=SimpleNamespace(read=read),
        approve=agreed.append,
    )
    with pytest.raises(NoSolutionError, match=r"was moved by .* since its room was proven; nothing was comm"):
        measure_delay(cell, SafetyOptions())


def test_the_swing_keeps_the_joints_limits_and_ends_where_it_began():
    for arm in (ARM, ARM.slowed(0.02), load_arm("panda")):
        chosen, size = swing_joints(arm), swing_size(arm)
        times = np.arange(0.0, SECONDS + 1e-9, 1e-3)
        joints, speeds = zip(*(swing(np.zeros(arm.dof), chosen, size, t) for t in times), strict=True)
        joints, speeds = np.array(joints), np.array(speeds)
        assert (np.abs(np.diff(joints, axis=0)) <= 1e-3 * arm.joint_speed).all()
        assert (np.abs(np.diff(joints, 2, axis=0)) <= 1e-6 * arm.joint_acceleration).all()
        assert joints[[0, -1]] == pytest.approx(0.0, abs=1e-9)
        assert np.abs(joints[1:] - joints[:-1] - 0.5e-3 * (speeds[1:] + speeds[:-1])).max() < 1e-3 * size
