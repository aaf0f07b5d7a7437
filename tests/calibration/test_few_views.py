"""With few views, distortion is kept where views left out want it much, not where they want it a little."""

import numpy as np
import pytest
from benchmarks.calibration_accuracy import real_sets

from omniservo.calibration import calibrate_camera
from omniservo.calibration.adjustment.held_out import HeldOut, distortion_helps


def held_out(views):
    """Errors of views left out, [px]."""
    return HeldOut(float(np.sqrt(np.mean(np.square(views)))), 0.0, np.array(views), (), np.zeros((0, 2)))


def test_a_large_gain_of_four_views_is_believed_and_a_small_one_is_not():
    plain = held_out([2.0, 1.4, 2.4, 1.9])
    assert distortion_helps(plain, held_out([0.8, 0.9, 0.7, 0.8]))[0]
    helps, reason = distortion_helps(plain, held_out([1.9, 1.25, 2.5, 1.6]))
    assert not helps
    assert reason.endswith("1% and p ≤ 0.01 or 20% and p ≤ 0.05 are needed")


def test_a_large_gain_that_one_view_alone_brings_is_not_believed():
    assert not distortion_helps(held_out([4.0, 1.0, 1.0, 1.0]), held_out([1.0, 1.05, 0.95, 1.0]))[0]


@pytest.mark.slow
def test_four_real_views_of_a_bent_lens_keep_its_distortion():
    found = {corners.name: corners for corners in real_sets()}
    if "OpenCV's own" not in found:
        pytest.skip("real data not present: ../shared/data")
    corners, kept = found["OpenCV's own"], 0
    for first in (0, 2, 5):
        views = [first, first + 3, first + 5, first + 8]
        made = calibrate_camera(
            [corners.pixels[i] for i in views], [corners.points[i] for i in views], corners.size
        )
        kept += made.distortion == "radtan"
    assert kept == 3
