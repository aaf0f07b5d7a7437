"""Stamps that are off by what was measured of them."""

import numpy as np
import pytest

from omniservo.hardware.shifted_camera import ShiftedCamera
from omniservo.robots import CameraImage


class Still:
    """One image, or none."""

    def __init__(self, image, notice=None):
        self._image, self.closed = image, False
        if notice is not None:
            self.notice = notice

    def image(self):
        return self._image

    def close(self):
        self.closed = True


def test_an_images_stamp_plus_the_offset_is_the_joints_time():
    pixels = np.zeros((2, 3), np.uint8)
    shifted = ShiftedCamera(Still(CameraImage(10.0, pixels, 0.002)), -0.04).image()
    assert (shifted.time, shifted.time_sigma) == (9.96, 0.002)
    assert shifted.pixels is pixels


def test_an_image_s_time_is_no_surer_than_the_offset():
    image = CameraImage(10.0, np.zeros((2, 3), np.uint8), 0.003)
    assert ShiftedCamera(Still(image), -0.04, 0.004).image().time_sigma == pytest.approx(0.005)


def test_before_the_first_image_there_is_none_and_what_is_assumed_is_passed_on():
    assert ShiftedCamera(Still(None), 0.1).image() is None
    assert ShiftedCamera(Still(None, "arrivals count"), 0.1).notice == "arrivals count"
    assert ShiftedCamera(Still(None), 0.1).notice is None


def test_closing_it_closes_the_camera():
    camera = Still(None)
    ShiftedCamera(camera, 0.1).close()
    assert camera.closed
