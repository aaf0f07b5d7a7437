"""The next image of a camera is one that was not there before."""

import numpy as np
import pytest

from omniservo.errors import StaleImage
from omniservo.robots import CameraImage, next_image

PIXELS = np.zeros((2, 2), dtype=np.uint8)


class Camera:
    """Delivers frames at the given times, exposed 10 ms before."""

    def __init__(self, *delivered):
        self.delivered, self.time = delivered, 0.0

    def image(self):
        there = [time for time in self.delivered if time <= self.time + 1e-9]
        return CameraImage(max(there) - 0.01, PIXELS) if there else None

    def wait(self, duration):
        self.time += duration


def test_what_was_delivered_before_is_not_the_next():
    camera = Camera(0.0, 0.05, 0.1)
    assert next_image(camera, camera.wait).time == pytest.approx(0.04)
    assert camera.time == pytest.approx(0.05)


def test_the_first_image_that_comes_is_the_next():
    camera = Camera(0.03)
    assert next_image(camera, camera.wait).time == pytest.approx(0.02)


@pytest.mark.parametrize("camera", [Camera(), Camera(0.0)])
def test_a_camera_that_gives_no_new_image_is_a_stop_by_its_name(camera):
    with pytest.raises(StaleImage, match="no new image for 0.2 s"):
        next_image(camera, camera.wait, patience=0.2)
    assert camera.time == pytest.approx(0.2, abs=2e-3)
