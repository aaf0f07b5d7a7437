"""What lens, sensor and compression do to the light: each against its definition."""

import cv2
import numpy as np
import pytest

from omniservo.scenes import Sensor
from omniservo.simulation.sensor_effects import compressed, disc, grey_values, light_left

CLEAN = {"noise": 0.0, "blur": 0.0}
RAMP = np.repeat(np.linspace(0.1, 0.8, 8), 40)[None].repeat(400, axis=0)
SCENE = np.kron(np.random.default_rng(3).uniform(0.1, 0.9, (24, 32)), np.ones((10, 10)))


def photo(image, seed=0, **sensor):
    return grey_values(image, Sensor(**(CLEAN | sensor)), np.random.default_rng(seed)).astype(float)


@pytest.mark.parametrize("gain", [0.05, 0.4])
def test_shot_noise_has_a_variance_proportional_to_the_signal(gain):
    found = photo(RAMP, gain=gain, noise=1.5)
    for k, grey in enumerate(np.linspace(0.1, 0.8, 8) * 255):
        patch = found[:, 40 * k : 40 * k + 40]
        assert patch.mean() == pytest.approx(grey, abs=5 * np.sqrt(gain * grey / patch.size) + 0.1)
        assert patch.var() == pytest.approx(gain * grey + 1.5**2 + 1 / 12, rel=0.06)


def test_noise_of_two_pixels_and_of_two_pictures_is_independent():
    first, second = photo(RAMP, 1, gain=0.4) - 255 * RAMP, photo(RAMP, 2, gain=0.4) - 255 * RAMP
    for other in (second, np.roll(first, 1, axis=0), np.roll(first, 1, axis=1)):
        assert abs(np.corrcoef(first.ravel(), other.ravel())[0, 1]) < 5 / np.sqrt(first.size)


def test_a_camera_without_new_effects_draws_the_noise_that_it_drew_before():
    draws = np.random.default_rng(4).standard_normal(RAMP.shape, dtype=np.float32)
    expected = np.clip(np.rint((255 * RAMP).astype(np.float32) + np.float32(2.0) * draws), 0, 255)
    np.testing.assert_array_equal(photo(RAMP, 4, noise=2.0), expected)


def test_vignetting_takes_the_stated_share_in_the_corners_and_nothing_in_the_middle():
    even = np.full((101, 141), 0.8)
    found = photo(even, vignetting=0.4)
    assert found[50, 70] == 204
    corners = found[[0, 0, -1, -1], [0, -1, 0, -1]]
    np.testing.assert_allclose(corners, 0.6 * 204, atol=0.5)
    row, column = np.indices(even.shape)
    share = ((row - 50) ** 2 + (column - 70) ** 2) / (50**2 + 70**2)
    np.testing.assert_allclose(found, 204 * (1 - 0.4 * share), atol=0.51)
    assert (light_left(0.0, 5, 7) == 1.0).all()


@pytest.mark.parametrize("radius", [0.3, 1.0, 2.5])
def test_defocus_spreads_a_point_evenly_over_its_disc(radius):
    kernel = disc(radius)
    middle = kernel.shape[0] // 2
    offsets = np.arange(-middle, middle + 1)
    assert kernel.sum() == pytest.approx(1.0, abs=1e-6)
    assert kernel.sum(axis=0) @ offsets == pytest.approx(0.0, abs=1e-6)
    ends = np.clip(np.append(offsets - 0.5, middle + 0.5), -radius, radius)
    segments = np.diff(ends * np.sqrt(radius**2 - ends**2) + radius**2 * np.arcsin(ends / radius))
    np.testing.assert_allclose(kernel.sum(axis=0), segments / (np.pi * radius**2), atol=0.01)
    point = np.zeros((15, 15))
    point[7, 7] = 1.0
    found = photo(point, defocus=radius)
    window = slice(7 - middle, 8 + middle)
    np.testing.assert_allclose(found[window, window], 255 * kernel, atol=0.51)


@pytest.mark.filterwarnings("error")
def test_the_darkest_and_the_smallest_images_are_photographed():
    """A large disc passes a Fourier transform: what was black came out below 0, which has no shot noise."""
    image = np.zeros((64, 64))
    image[:, 20:40] = 1.0
    found = photo(image, defocus=6.0, gain=0.1)
    assert found[:, 30].mean() == pytest.approx(255.0, abs=3.0)
    assert (found[:, :10] == 0.0).all()
    assert photo(np.full((1, 1), 0.5), vignetting=0.3).item() == 128.0
    assert (photo(np.full((4, 4), 0.8), gain=1e-20) == 204.0).all()


@pytest.mark.parametrize("quality", [1, 80, 100])
def test_jpeg_is_what_opencvs_codec_gives(quality):
    plain = photo(SCENE).astype(np.uint8)
    data = cv2.imencode(".jpg", plain, [cv2.IMWRITE_JPEG_QUALITY, quality])[1]
    expected = cv2.imdecode(data, cv2.IMREAD_GRAYSCALE)
    np.testing.assert_array_equal(photo(SCENE, jpeg=quality), expected)
    np.testing.assert_array_equal(compressed(plain, quality), expected)
    assert expected.shape == plain.shape


def test_worse_compression_leaves_less():
    errors = [np.abs(photo(SCENE, jpeg=q) - photo(SCENE)).mean() for q in (95, 60, 10)]
    assert 0.0 < errors[0] < errors[1] < errors[2]
