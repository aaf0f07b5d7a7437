import board_views
import numpy as np
import pytest

from omniservo import calibrate_camera, preset
from omniservo.cameras import ModelError


def calibrated(sigma, seed=0):
    """Calibrate from corners with 0.05 px of noise under a camera whose pixels are off by a smooth field."""
    camera, rng = preset("fe185"), np.random.default_rng(seed)
    pixels, points = board_views.draw_views(camera, rng, views=14, noise_px=0.05)
    rows = ModelError(sigma, 0.1 * camera.width).rows(np.concatenate(pixels))
    field = np.stack([rng.standard_normal(len(rows)) @ rows for _ in range(2)], axis=1)
    seen = [p + e for p, e in zip(pixels, np.split(field, len(pixels)), strict=True)]
    return calibrate_camera(seen, points, (camera.width, camera.height), distortion="none")


@pytest.mark.slow
@pytest.mark.parametrize("seed", [0, 1])
def test_a_smooth_lens_error_is_found_in_views_left_out(seed):
    found = calibrated(0.3, seed=seed).camera.model_error
    assert 0.15 < found.sigma_px < 0.6


def test_an_exact_camera_has_next_to_no_error():
    found = calibrated(0.0).camera.model_error
    assert found.sigma_px < 0.03


@pytest.mark.slow
def test_parameters_of_a_camera_that_is_off_are_less_well_known():
    exact, off = calibrated(0.0), calibrated(0.3)
    assert np.all(off.standard_deviations[:2] > 2.0 * exact.standard_deviations[:2])
