"""The offset of a camera's stamps, from points and joints made by exact projection."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import RigidTransform, Rotation

from omniservo.calibration.camera_delay import DelayViews, camera_delay
from omniservo.cameras import PRESETS
from omniservo.errors import NoSolutionError
from omniservo.hardware import JointHistory
from omniservo.robots import Arm, RobotState

CAMERA = PRESETS["fe185"]
ARM = Arm.rx60()
START = np.deg2rad([10.0, 20.0, 80.0, 5.0, 40.0, 10.0])
MOUNT = RigidTransform.from_components([0.02, 0.0, 0.05], Rotation.from_rotvec([0.1, 0.05, 0.3]))


def joints_at(times, size=2.0):
    """Two joints that swing, each at its own pace."""
    joints = np.tile(START, (len(times), 1))
    joints[:, 3] += np.deg2rad(size) * np.sin(2.0 * np.pi * 0.9 * times)
    joints[:, 4] += np.deg2rad(size) * np.sin(2.0 * np.pi * 1.3 * times + 0.4)
    return joints


def views(offset, seed=0, *, noise=0.3, count=12, size=2.0, truth=lambda joints: joints):
    """Images whose stamps are ``offset`` [s] early, of points 0.3 m to 2 m away."""
    rng = np.random.default_rng(seed)
    readings = np.arange(0.0, 1.95, 1 / 125)
    history = JointHistory(6)
    for time, q, after in zip(
        readings, joints_at(readings, size), joints_at(readings + 1e-5, size), strict=True
    ):
        history.add(RobotState(float(time), q, (after - q) / 1e-5))
    stamps = np.arange(0.1, 1.85, 1 / 30) - offset
    stamps = stamps[(stamps + offset > 0.05) & (stamps + offset < 1.9)]
    poses = [ARM.base_T_flange(q) * MOUNT for q in truth(joints_at(stamps + offset, size))]
    pixels = rng.uniform([150, 150], [CAMERA.width - 150, CAMERA.height - 150], (count, 2))
    points = CAMERA.unproject(pixels)[0] * rng.uniform(0.3, 2.0, (count, 1))
    world = poses[0].apply(points)
    tracks = np.array([CAMERA.project(pose.inv().apply(world))[0] for pose in poses])
    return DelayViews(stamps, tracks + rng.normal(0.0, noise, tracks.shape), history)


@pytest.mark.parametrize("offset", [0.0, 0.06, -0.2])
def test_the_offset_is_found_to_two_milliseconds(offset):
    found = camera_delay(CAMERA, ARM, MOUNT, views(offset))
    assert found.offset == pytest.approx(offset, abs=2e-3)
    assert found.sigma < 1e-3
    assert found.rms_px == pytest.approx(0.3 * np.sqrt(2.0), rel=0.1)


def test_its_standard_deviation_holds():
    errors = []
    for seed in range(8):
        found = camera_delay(CAMERA, ARM, MOUNT, views(0.03, seed, count=7))
        errors.append((found.offset - 0.03) / found.sigma)
    assert 0.5 < np.sqrt(np.mean(np.square(errors))) < 1.7


def test_what_all_stamps_are_off_alike_is_counted():
    """Another connection's stamps are off anew: the residuals of one know nothing of it."""
    errors = []
    for seed in range(8):
        off = np.random.default_rng(100 + seed).normal(0.0, 2e-3)
        found = camera_delay(CAMERA, ARM, MOUNT, replace(views(0.03 + off, seed), time_sigma=2e-3))
        assert found.sigma >= 2e-3
        errors.append((found.offset - 0.03) / found.sigma)
    assert 0.5 < np.sqrt(np.mean(np.square(errors))) < 1.7


def test_a_mount_that_is_a_degree_off_hardly_matters():
    off = MOUNT * RigidTransform.from_rotation(Rotation.from_rotvec(np.deg2rad([0.6, -0.6, 0.5])))
    found = camera_delay(CAMERA, ARM, off, views(0.06))
    assert found.offset == pytest.approx(0.06, abs=3e-3)


def test_too_little_motion_is_refused():
    with pytest.raises(NoSolutionError, match="px/s; at least 20"):
        camera_delay(CAMERA, ARM, MOUNT, views(0.0, size=0.05, noise=0.0))


def test_too_few_points_are_refused():
    with pytest.raises(NoSolutionError, match="5 points could be tracked"):
        camera_delay(CAMERA, ARM, MOUNT, views(0.0, count=5))


def test_a_joint_that_turns_the_other_way_is_refused():
    def turned(joints):
        return np.where(np.arange(6) == 4, 2.0 * START - joints, joints)

    with pytest.raises(NoSolutionError, match="the joints do not explain the images"):
        camera_delay(CAMERA, ARM, MOUNT, views(0.0, truth=turned))


def test_points_that_move_with_the_camera_are_outliers():
    seen = views(0.06)
    seen.tracks[:, :4] = seen.tracks[:1, :4]  # such as a gripper in view
    found = camera_delay(CAMERA, ARM, MOUNT, seen)
    assert found.offset == pytest.approx(0.06, abs=2e-3)


def test_points_beyond_the_lens_are_left_out():
    seen = views(0.06)
    seen.tracks[:, 0] = [1.0, 1.0]
    assert camera_delay(CAMERA, ARM, MOUNT, seen).offset == pytest.approx(0.06, abs=2e-3)
