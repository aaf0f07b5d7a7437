"""The virtual plane of the paper, both ways."""

import math

import numpy as np
import pytest

from omniservo.cameras import UnifiedCamera, from_virtual_plane, preset, to_virtual_plane
from omniservo.errors import InputError


def test_plane_point_is_gamma_times_the_normalised_point(plain_camera):
    """(4)–(6) literally, where they lose no digits."""
    camera = plain_camera
    rng = np.random.default_rng(0)
    limit = 0.9 / camera.xi if camera.xi > 0 else 2.0
    mean = rng.uniform(-limit, limit, (500, 2)) / math.sqrt(2)
    pixels = np.column_stack([mean, np.ones(500)]) @ camera.matrix[:2].T
    r2 = (mean**2).sum(axis=1)
    delta = np.sqrt(1 + (1 - camera.xi**2) * r2)
    gamma = (1 + camera.xi * delta) / (1 - camera.xi**2 * r2)
    points, valid = to_virtual_plane(camera, pixels)
    assert valid.any()
    assert np.abs(points - gamma[:, None] * mean)[valid].max() < 1e-9


def test_round_trip_holds_in_front_of_the_camera(camera):
    rng = np.random.default_rng(1)
    angle = rng.uniform(0, min(camera.usable_angle, math.pi / 2) * 0.99, 1000)
    azimuth = rng.uniform(0, 2 * np.pi, 1000)
    plane = np.tan(angle)[:, None] * np.column_stack([np.cos(azimuth), np.sin(azimuth)])
    pixels, valid = from_virtual_plane(camera, plane)
    assert valid.all()
    again, seen = to_virtual_plane(camera, pixels)
    assert seen.all()
    assert (np.abs(again - plane).max(axis=1) < 1e-9 * (1 + np.tan(angle) ** 2)).all()


def test_nothing_at_or_behind_ninety_degrees_has_a_plane_point():
    camera = preset("fe185")
    angles = np.radians([89.9, 90.1, 92.0])
    pixels, seen = camera.project(np.column_stack([np.sin(angles), 0 * angles, np.cos(angles)]))
    assert seen.all()
    points, valid = to_virtual_plane(camera, pixels)
    assert valid.tolist() == [True, False, False]
    assert np.isnan(points[1:]).all()


@pytest.mark.parametrize(("angle", "amplification"), [(60, 3.4), (80, 25), (85, 98)])
def test_noise_is_amplified_as_stated(angle, amplification):
    """Along the radius, relative to the centre, for the paper's ξ."""
    camera = UnifiedCamera(296.9365, 296.9365, 320.0, 240.0, 1.2910, 659, 432)

    def slope(a):
        pixel, _ = camera.project([math.sin(a), 0.0, math.cos(a)])
        ends, _ = to_virtual_plane(camera, pixel + np.array([[-1e-4, 0], [1e-4, 0]]))
        return (ends[1, 0] - ends[0, 0]) / 2e-4

    assert slope(math.radians(angle)) / slope(0.0) == pytest.approx(amplification, rel=0.03)


def test_points_that_are_not_finite_are_refused():
    with pytest.raises(InputError, match="points"):
        from_virtual_plane(preset("fe185"), [np.nan, 0.0])
