"""How far a picture is smeared by motion."""

import cv2
import numpy as np
import pytest
from benchmarks.pictured_scenes import LENS, crate, motion, picture_of, smeared

from omniservo.errors import InputError
from omniservo.perception import match_images
from omniservo.perception.smear_length import smear_length


@pytest.fixture(scope="module")
def pictures():
    """Six pictures of crates that do not move."""
    found = []
    for seed in range(6):
        rng = np.random.default_rng([1, seed])
        found.append(picture_of(crate(rng), LENS, motion(rng), rng, rays=2))
    return found


@pytest.mark.parametrize("length", [17, 21, 25])
def test_the_length_of_a_smear_is_found_in_most_pictures(pictures, length):
    found = []
    for seed, picture in enumerate(pictures):
        found.append(smear_length(smeared(picture, length, np.random.default_rng([length, seed]))))
    assert sum(abs(each - length) <= 3 for each in found) >= 5


def test_pictures_that_did_not_move_are_not_smeared(pictures):
    for picture in pictures:
        assert smear_length(picture) == 0
        assert smear_length(cv2.GaussianBlur(picture, (0, 0), 6.0)) == 0  # out of focus, not moved
    assert smear_length(np.full((30, 40), 128, np.uint8)) == 0


def test_soft_light_along_bars_is_no_smear():
    rng = np.random.default_rng(3)
    for _ in range(8):
        bars = np.repeat(rng.uniform(40, 220, 80), 4) * np.ones((240, 1))
        light = cv2.resize(rng.uniform(-40, 40, (4, 4)), (320, 240), interpolation=cv2.INTER_CUBIC)
        seen = bars + light + 2.0 * rng.standard_normal(bars.shape)
        assert smear_length(np.clip(seen, 0, 255).astype(np.uint8)) == 0


def test_few_pixels_that_overlap_do_not_make_a_small_picture_smeared():
    rng = np.random.default_rng(0)
    found = []
    for _ in range(80):
        surface = cv2.GaussianBlur(rng.standard_normal((176, 188)), (0, 0), sigmaX=2.0, sigmaY=1.2)
        turn = cv2.getRotationMatrix2D((94, 88), rng.uniform(0, 180), 1.0)
        seen = cv2.warpAffine(surface, turn, (188, 176))[70:106, 70:118]
        seen = 128 + 40 * seen / seen.std() + 2 * rng.standard_normal(seen.shape)
        found.append(smear_length(np.clip(seen, 0, 255).astype(np.uint8)))
    assert np.count_nonzero(found) <= 2


def test_a_smeared_picture_is_refused_by_name():
    rng = np.random.default_rng(5)
    faces = crate(rng)
    pictures = [picture_of(faces, LENS, motion(rng), rng, rays=2) for _ in range(2)]
    assert match_images(LENS, *pictures).status == "ok"
    blurred = match_images(LENS, pictures[0], smeared(pictures[1], 21, rng))
    assert (blurred.status, len(blurred)) == ("blurred", 0)
    assert blurred.reason.startswith("the goal picture is smeared by motion over 2")
    with pytest.raises(InputError, match="given; the camera's is"):
        match_images(LENS, smeared(pictures[1], 21, rng), pictures[0][1:])
