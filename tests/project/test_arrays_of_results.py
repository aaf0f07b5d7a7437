"""Arrays that results hand out work with the libraries that people hand them to."""

import copy
import dataclasses
import pickle

import cv2
import mujoco
import numpy as np
import pytest
from scipy.spatial.transform import RigidTransform, Rotation

from omniservo import calibrate_camera, estimate_pose, estimate_two_view, estimate_views, preset
from omniservo.calibration.boards import Checkerboard
from omniservo.perception import ImagePoints
from omniservo.targets import Tag, Target

CAMERA = preset("fe185")
CORNERS = np.array([[x, y, 0.0] for y in range(6) for x in range(5)]) * 0.04 - [0.08, 0.1, 0.0]
POINTS = np.random.default_rng(4).uniform(-0.15, 0.15, (20, 3)) + np.array([0.0, 0.0, 0.5])
FIRST = RigidTransform.identity()
SECOND = RigidTransform.from_components([0.08, 0.02, 0.05], Rotation.from_rotvec([0.05, -0.1, 0.2]))
THIRD = RigidTransform.from_components([-0.06, 0.05, 0.02], Rotation.from_rotvec([-0.1, 0.1, 0.1]))


def seen(camera_pose, points=POINTS):
    return CAMERA.project(camera_pose.inv().apply(points))[0]


def calibration():
    shots = np.random.default_rng(1).normal(0.0, 0.25, (6, 3))
    poses = [RigidTransform.from_components([0.0, 0.0, 0.3], Rotation.from_rotvec(turn)) for turn in shots]
    pixels = [CAMERA.project(pose.apply(CORNERS))[0] for pose in poses]
    return calibrate_camera(pixels, [CORNERS] * len(poses), (659, 432), distortion="none")


RESULTS = {
    "two views": lambda: estimate_two_view(CAMERA, seen(FIRST), seen(SECOND), scale=0.1),
    "pose": lambda: estimate_pose(CAMERA, POINTS, seen(SECOND)),
    "three views": lambda: estimate_views(CAMERA, [seen(FIRST), seen(SECOND), seen(THIRD)]),
    "calibration": calibration,
    "image points": lambda: ImagePoints(seen(SECOND), np.tile(np.eye(2), (len(POINTS), 1, 1))),
    "target": lambda: Target(tuple(map(str, range(len(POINTS)))), POINTS),
    "tag": lambda: Tag("tag36h11", 3, 0.05, SECOND),
    "board": lambda: Checkerboard(8, 5, 0.03),
}


def arrays_of(result):
    names = {field.name for field in dataclasses.fields(result)}
    names |= {name for name in dir(type(result)) if isinstance(getattr(type(result), name), property)}
    values = {name: getattr(result, name) for name in names if not name.startswith("_")}
    values |= {
        f"{name}[{key}]": value
        for name, held in values.items()
        if isinstance(held, dict)
        for key, value in held.items()
    }
    return {name: v for name, v in values.items() if isinstance(v, np.ndarray) and v.dtype == np.float64}


@pytest.mark.parametrize("kind", RESULTS)
def test_every_array_of_a_result_is_taken_by_scipy_opencv_and_mujoco(kind):
    result = RESULTS[kind]()
    arrays = arrays_of(result)
    assert arrays
    for name, array in arrays.items():
        flat = array.reshape(-1, 3) if array.size % 3 == 0 else np.resize(array, (1, 3))
        assert array.flags.writeable, name
        if array.ndim == 2 and array.shape[1] == 3:
            turned = Rotation.from_rotvec([0.0, 0.0, 0.1]).apply(array)
            np.testing.assert_allclose(Rotation.from_rotvec(array).apply(turned[0]).shape, array.shape)
            cv2.projectPoints(array, np.zeros(3), np.zeros(3), np.eye(3), None)
        mujoco.mju_normalize3(flat[0])


def test_writing_to_a_result_changes_nothing_that_it_came_from():
    pixels = seen(SECOND)
    before = pixels.copy()
    estimate = estimate_pose(CAMERA, POINTS, pixels)
    again = estimate.residuals_px.copy()
    estimate.residuals_px[:] = 7.0
    estimate.covariance[:] = 7.0
    np.testing.assert_array_equal(pixels, before)
    np.testing.assert_array_equal(estimate_pose(CAMERA, POINTS, pixels).residuals_px, again)


@pytest.mark.parametrize("kind", RESULTS)
def test_another_process_is_given_every_array_of_a_result(kind):
    result = RESULTS[kind]()
    sent = pickle.loads(pickle.dumps(result))  # noqa: S301
    arrays = arrays_of(result)
    assert arrays_of(sent).keys() == arrays.keys()
    for name, array in arrays_of(sent).items():
        np.testing.assert_array_equal(array, arrays[name])


def test_a_covariance_that_is_read_late_is_that_of_the_estimate_as_it_was():
    expected = RESULTS["two views"]()
    written = RESULTS["two views"]()
    kept = copy.copy(written)
    written.inliers[:5] = False
    for late in (written, kept):
        np.testing.assert_array_equal(late.covariance, expected.covariance)
        np.testing.assert_array_equal(late.points_covariance, expected.points_covariance)
