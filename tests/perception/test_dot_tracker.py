"""Dots followed through pictures of a moving camera."""

import dot_scenes
import numpy as np
import pytest
from dot_scenes import Patch, Scene, dot_patches, plane_axes, render

from omniservo.errors import InputError
from omniservo.perception import DotTracker, find_dots

CAMERA = dot_scenes.paper_camera()
FRONT = np.array([0.0, 0.0, -1.0])


def target(shift=(0.0, 0.0, 0.0)):
    """Nine dots on a board: centres (9, 3) and the scene."""
    x, y = (g.ravel() * 0.05 for g in np.meshgrid([-1.0, 0.0, 1.0], [-1.0, 0.0, 1.0]))
    centres = np.stack([x, y, np.full(9, 0.35)], 1) + shift
    board = Patch(centres[4] + [0, 0, 1e-4], plane_axes(FRONT), (0.1, 0.1), 215.0)
    return centres, [board, *dot_patches(centres, np.tile(FRONT, (9, 1)), 0.008)[1::2]]


def picture(shift=(0.0, 0.0, 0.0), cover=()):
    centres, patches = target(shift)
    return CAMERA.project(centres)[0], render(CAMERA, Scene([*patches, *cover]))


@pytest.mark.slow
def test_dots_are_followed_through_a_dropout_and_found_again():
    tracker = DotTracker(CAMERA)
    expected, _ = picture()
    for step in range(8):
        hidden = step in (3, 4)
        middle = target((0.006 * step, 0, 0))[0][4]
        cover = [Patch(0.9 * middle, plane_axes(FRONT), (0.012, 0.012), 120.0)] if hidden else []
        true, image = picture((0.006 * step, 0.0, 0.0), cover)
        pixels, valid = tracker.update(image, expected)
        assert valid[4] == (not hidden)
        assert np.delete(valid, 4).all()
        assert np.linalg.norm(pixels - true, axis=1)[valid].max() < 0.1
        assert np.isnan(pixels[~valid]).all()
        expected = np.where(valid[:, None], pixels, expected + np.array([2.2, 0.0]))


def test_order_is_that_of_the_predictions():
    true, image = picture()
    order = np.array([4, 0, 8, 2, 6, 1, 7, 3, 5])
    pixels, valid = DotTracker(CAMERA).update(image, true[order] + 3.0)
    assert valid.all()
    assert np.linalg.norm(pixels - true[order], axis=1).max() < 0.1


def test_tracking_and_finding_agree():
    true, image = picture()
    pixels, _ = DotTracker(CAMERA).update(image, true)
    found = find_dots(image, CAMERA).pixels
    assert np.abs(pixels[np.lexsort(pixels.T)] - found).max() < 0.01


def test_an_empty_window_is_lost_and_never_a_number():
    true, image = picture()
    pixels, valid = DotTracker(CAMERA).update(image, true + np.array([0.0, 60.0]))
    lost = ~valid
    assert lost[6:].all()
    assert np.isnan(pixels[lost]).all()


def test_a_black_picture_loses_all():
    pixels, valid = DotTracker(CAMERA).update(np.zeros((432, 659), np.uint8), picture()[0])
    assert not valid.any()
    assert np.isnan(pixels).all()


def test_a_prediction_that_is_nan_or_far_outside_stays_lost():
    true, image = picture()
    predicted = true.copy()
    predicted[0] = np.nan
    predicted[1] = [1e7, -1e7]
    predicted[2] = [np.inf, 0.0]
    pixels, valid = DotTracker(CAMERA).update(image, predicted)
    assert valid.tolist() == [False] * 3 + [True] * 6
    assert np.isfinite(pixels[3:]).all()


def test_beyond_the_gate_a_dot_is_not_taken():
    true, image = picture()
    _, valid = DotTracker(CAMERA, gate_px=3.0).update(image, true + np.array([4.0, 0.0]))
    assert not valid.any()


def test_up_to_the_gate_a_dot_is_taken():
    true, image = picture()
    outwards = (true[0] - true[4]) / np.linalg.norm(true[0] - true[4])  # away from all others
    for off, taken in ((11.8, True), (12.2, False)):
        pixels, valid = DotTracker(CAMERA, gate_px=12.0).update(image, true[:1] + off * outwards)
        assert valid.tolist() == [taken]
        assert not taken or np.linalg.norm(pixels - true[:1]) < 0.1


def test_two_predictions_never_share_a_dot():
    true, image = picture()
    predicted = np.array([true[4] + [1.0, 0.0], true[4] + [-2.0, 0.0]])
    _, valid = DotTracker(CAMERA).update(image, predicted)
    assert valid.tolist() == [True, False]


def test_half_way_between_two_dots_none_is_taken():
    true, image = picture()
    _, valid = DotTracker(CAMERA, gate_px=20.0).update(image, (true[3:4] + true[4:5]) / 2)
    assert not valid.any()


def test_no_predictions_give_no_dots():
    pixels, valid = DotTracker(CAMERA).update(picture()[1], np.zeros((0, 2)))
    assert pixels.shape == (0, 2)
    assert valid.shape == (0,)


def test_wrong_calls_are_refused():
    with pytest.raises(InputError, match="gate_px"):
        DotTracker(CAMERA, gate_px=0)
    with pytest.raises(InputError, match="predicted_pixels"):
        DotTracker(CAMERA).update(picture()[1], np.zeros(3))
    with pytest.raises(InputError, match="image"):
        DotTracker(CAMERA).update(np.zeros((432, 659)), np.zeros((1, 2)))
