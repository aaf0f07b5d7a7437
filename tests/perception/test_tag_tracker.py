"""Tags followed through pictures of a moving camera."""

import numpy as np
import pytest
import tag_scenes
from tag_scenes import facing, render, true_pixels

from omniservo.cameras import UnifiedCamera
from omniservo.errors import InputError
from omniservo.perception import TagTracker, find_tags
from omniservo.perception.tag_kind import CornerTracker

CAMERA = tag_scenes.cameras()["fe185"]
IDS = (5, 2)


def tags(shift=(0.0, 0.0, 0.0)):
    """Two tags, at 15° and 55° from the axis, seen by a camera that has moved by −shift."""
    placed = [
        facing("tag36h11", 5, [0.27, 0.05, 1.0], 1.0, 0.22, lean=(0.2, -0.3), spin=0.4),
        facing("tag36h11", 2, [-1.4, -0.1, 1.0], 1.0, 0.22, lean=(0.3, 0.1), spin=2.0),
    ]
    return [
        tag_scenes.PlacedTag(t.name, t.number, t.centre + np.array(shift), t.axes, t.side) for t in placed
    ]


def picture(shift=(0.0, 0.0, 0.0)):
    seen = tags(shift)
    return np.concatenate([true_pixels(CAMERA, tag) for tag in seen]), render(CAMERA, seen)


TRUE, IMAGE = picture()


def tracker(**options):
    return TagTracker(CAMERA, "tag36h11", IDS, **options)


def test_tags_are_followed_through_a_dropout_and_found_again():
    expected = TRUE
    for step in range(6):
        true, image = picture((0.012 * step, -0.008 * step, 0.0))
        hidden = step in (2, 3)
        if hidden:
            u, v = true[:4].mean(axis=0).astype(int)
            image[v - 40 : v + 40, u - 40 : u + 40] = 120
        pixels, valid = tracker().update(image, expected)
        assert valid.tolist() == [not hidden] * 4 + [True] * 4
        assert np.linalg.norm(pixels - true, axis=1)[valid].max() < 0.08
        assert np.isnan(pixels[~valid]).all()
        expected = np.where(valid[:, None], pixels, true - 2.0)


@pytest.mark.parametrize("off", [0.3, 3.0, 7.0])
def test_a_prediction_may_be_off_by_less_than_the_gate(off):
    rng = np.random.default_rng(int(10 * off))
    aside = np.repeat(rng.standard_normal((2, 2)), 4, axis=0)
    aside *= off / np.linalg.norm(aside, axis=1, keepdims=True)
    pixels, valid = tracker().update(IMAGE, TRUE + aside)
    assert valid.all()
    assert np.linalg.norm(pixels - TRUE, axis=1).max() < 0.08


def test_tracking_and_finding_agree():
    pixels, _ = tracker().update(IMAGE, TRUE + 1.0)
    found = find_tags(IMAGE, CAMERA)
    order = [found.ids.tolist().index(number) for number in IDS]
    assert np.abs(pixels.reshape(2, 4, 2) - found.corners[order]).max() < 0.03


def test_beyond_the_gate_a_tag_is_not_taken():
    _, valid = tracker(gate_px=3.0).update(IMAGE, TRUE + np.array([4.0, 0.0]))
    assert not valid.any()


def test_another_tag_at_the_place_is_not_taken():
    _, valid = TagTracker(CAMERA, "tag36h11", (6, 2)).update(IMAGE, TRUE)
    assert valid.tolist() == [False] * 4 + [True] * 4


def test_the_same_tag_turned_is_not_taken_for_itself():
    turned = TRUE.copy()
    turned[:4] = np.roll(TRUE[:4], 1, axis=0)
    _, valid = tracker().update(IMAGE, turned)
    assert valid.tolist() == [False] * 4 + [True] * 4


def test_two_tags_of_one_id_near_the_prediction_are_lost():
    first = facing("tag36h11", 5, [0.0, 0.0, 1.0], 1.0, 0.22)
    twins = [
        tag_scenes.PlacedTag(t.name, t.number, t.centre + np.array([x, 0.0, 0.0]), t.axes, t.side)
        for t, x in ((first, -0.15), (first, 0.15))
    ]
    image = render(CAMERA, twins)
    between = true_pixels(CAMERA, first)
    _, valid = TagTracker(CAMERA, "tag36h11", (5,), gate_px=60.0).update(image, between)
    assert not valid.any()


def test_pictures_without_tags_and_absurd_predictions_lose_all():
    for image in (
        np.zeros_like(IMAGE),
        np.random.default_rng(0).integers(0, 256, IMAGE.shape, dtype=np.uint8),
    ):
        pixels, valid = tracker().update(image, TRUE)
        assert not valid.any()
        assert np.isnan(pixels).all()
    predicted = TRUE.copy()
    predicted[1] = np.nan
    assert tracker().update(IMAGE, predicted)[1].tolist() == [False] * 4 + [True] * 4
    for absurd in (np.full((8, 2), 1e7), np.full((8, 2), np.inf), np.full((8, 2), 300.0), TRUE[::-1].copy()):
        assert not tracker().update(IMAGE, absurd)[1].any()


def test_no_tags_give_no_points():
    pixels, valid = TagTracker(CAMERA, "tag36h11", ()).update(IMAGE, np.zeros((0, 2)))
    assert pixels.shape == (0, 2)
    assert valid.shape == (0,)


def test_wrong_calls_are_refused():
    with pytest.raises(InputError, match="gate_px"):
        tracker(gate_px=0)
    with pytest.raises(InputError, match="ids: 600 given"):
        TagTracker(CAMERA, "tag36h11", (600,))
    with pytest.raises(InputError, match="stands once"):
        TagTracker(CAMERA, "tag36h11", (1, 1))
    with pytest.raises(InputError, match="predicted_pixels"):
        tracker().update(IMAGE, TRUE[:7])
    with pytest.raises(InputError, match="image"):
        tracker().update(np.zeros((3, 3), np.uint8), TRUE)


@pytest.mark.slow
@pytest.mark.parametrize("corner", range(4))
def test_through_a_lens_without_an_end_a_corner_without_prediction_loses_its_tag(corner):
    camera = UnifiedCamera(400.0, 400.0, 319.5, 239.5, 0.0, 640, 480)
    image = render(camera, [facing("tag36h11", 5, [0.0, 0.0, 1.0], 1.0, 0.3)])
    predicted = find_tags(image, camera).corners[0]
    assert TagTracker(camera, "tag36h11", (5,)).update(image, predicted)[1].all()
    predicted[corner] = np.nan
    pixels, valid = TagTracker(camera, "tag36h11", (5,)).update(image, predicted)
    assert not valid.any()
    assert np.isnan(pixels).all()


def test_a_prediction_is_needed_for_every_followed_corner():
    followed = CornerTracker(CAMERA, "tag36h11", 4 * IDS[0] + np.arange(4))
    with pytest.raises(InputError, match=r"predicted_pixels: shape \(1, 2\) given; \(4, 2\) is needed"):
        followed.update(IMAGE, TRUE[:1])
