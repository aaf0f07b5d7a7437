"""The camera of a recording as other programs take it: OpenCV projects by it as the camera does."""

import cv2
import numpy as np
import pytest

from omniservo import UnifiedCamera
from omniservo.cameras.models import DoubleSphere, KannalaBrandt, Pinhole
from omniservo.recording.camera_info import camera_info
from omniservo.ros_messages.messages import HeaderMessage

SIZE = (330.0, 335.0, 322.0, 239.0)
POINTS = np.random.default_rng(3).uniform([-0.4, -0.3, 0.8], [0.4, 0.3, 1.5], (20, 3))


@pytest.mark.parametrize(
    ("camera", "model"),
    [
        (UnifiedCamera(*SIZE, 0.0, 640, 480, distortion=(-0.1, 0.02, 0.001, -0.002)), "plumb_bob"),
        (Pinhole(*SIZE, 640, 480, distortion=(-0.1, 0.02, 0.001, -0.002, 0.01)), "plumb_bob"),
        (Pinhole(*SIZE, 640, 480, distortion=(-0.1, 0.02, 1e-3, -2e-3, 0.01, 0.02, 0.01, 0.001)),
         "rational_polynomial"),
        (KannalaBrandt(*SIZE, 640, 480, k=(0.02, -0.01, 0.003, -0.001)), "equidistant"),
    ],
)  # fmt: skip
def test_what_is_said_of_a_camera_projects_as_it_does(camera, model):
    info = camera_info(camera, HeaderMessage(frame_id="camera"))
    assert (info.width, info.height, info.distortion_model) == (640, 480, model)
    k, nothing = info.k.reshape(3, 3), np.zeros(3)
    if model == "equidistant":
        pixels = cv2.fisheye.projectPoints(POINTS[None], nothing, nothing, k, info.d)[0][0]
    else:
        pixels = cv2.projectPoints(POINTS, nothing, nothing, k, info.d)[0][:, 0]
    np.testing.assert_allclose(pixels, camera.project(POINTS)[0], atol=1e-6)
    np.testing.assert_array_equal(info.r.reshape(3, 3), np.eye(3))
    np.testing.assert_array_equal(info.p.reshape(3, 4), np.c_[k, nothing])


@pytest.mark.parametrize(
    "camera",
    [
        UnifiedCamera(*SIZE, 0.9, 640, 480),
        UnifiedCamera(*SIZE, 0.0, 640, 480, skew=0.5),
        DoubleSphere(*SIZE, -0.1, 0.6, 640, 480),
    ],
)
def test_a_camera_that_ros_has_no_name_for_is_not_said(camera):
    assert camera_info(camera, HeaderMessage()) is None
