"""Pixels of any model are carried into a unified image, where their bearings stay what they are."""

import math
from pathlib import Path

import numpy as np
import pytest
from benchmarks.lens_conversions import PUBLISHED, ended, lenses, row

from omniservo.cameras import UnifiedCamera, preset
from omniservo.cameras.conversion import to_unified, unified_image, unified_limits
from omniservo.cameras.models import DoubleSphere, Equirectangular, ExtendedUnified, camera_from_dict
from omniservo.errors import InputError

T265 = PUBLISHED["RealSense T265, fisheye"]


def pixels_of(lens, n=2000):
    """Pixels (n, 2) all over the image that see something."""
    edge = np.array([lens.width, lens.height]) - 0.5
    pixels = np.random.default_rng(0).uniform(-0.5, edge, (n, 2))
    return pixels[lens.unproject(pixels)[1]]


@pytest.mark.slow
@pytest.mark.parametrize("name", PUBLISHED)
def test_a_carried_pixel_has_the_bearing_of_the_camera_s_own_model(name):
    lens = PUBLISHED[name]
    pixels = pixels_of(lens)
    image = unified_image(lens)
    carried = image.carried(pixels)
    bearings, valid = image.camera.unproject(carried)
    assert valid.all()
    assert np.abs(bearings - lens.unproject(pixels)[0]).max() < 1e-12
    assert np.abs(image.returned(carried) - pixels).max() < 1e-8
    apart = np.linalg.norm(carried - pixels, axis=1).max()
    assert apart == pytest.approx(to_unified(lens).residual.largest_px, rel=0.05)


def test_pixels_of_a_unified_camera_are_carried_nowhere():
    image, pixels = unified_image(preset("fe185")), np.full((1, 2), 1e9)
    assert image.carried(pixels) is pixels
    assert image.returned(pixels) is pixels
    assert image.kept(pixels, np.ones(1, dtype=bool))[1].all()
    assert (image.scale(pixels) == 1.0).all()


def test_a_field_that_the_nearest_unified_camera_loses_is_seen_in_a_parabolic_one():
    panorama = Equirectangular(800, 400)
    assert to_unified(panorama).residual.lost > 0.2
    pixels, image = pixels_of(panorama), unified_image(panorama)
    bearings, valid = image.camera.unproject(image.carried(pixels))
    assert valid.all()
    assert np.abs(bearings - panorama.unproject(pixels)[0]).max() < 1e-9
    axis = np.array([[399.5, 199.5]])
    assert image.scale(axis) == pytest.approx(1.0, rel=1e-4)
    assert image.scale(axis + np.array([100.0, 0.0])) == pytest.approx(
        1.0 / math.cos(math.pi / 8.0) ** 2, rel=1e-3
    )


def test_the_scale_is_how_much_larger_a_small_square_becomes():
    image, pixels = unified_image(T265), pixels_of(T265, 50)
    corners = image.carried(pixels[:, None] + 0.01 * np.array([[-1, -1], [1, -1], [1, 1], [-1, 1]]))
    u, v = corners[..., 0], corners[..., 1]
    area = 0.5 * np.abs(np.sum(u * np.roll(v, -1, axis=1) - v * np.roll(u, -1, axis=1), axis=1))
    assert image.scale(pixels) == pytest.approx(np.sqrt(area) / 0.02, rel=1e-3)
    assert unified_image(ended(T265, 80.0)).scale(np.array([[2.0, 2.0]])) == 1.0, "where there is no bearing"


def test_the_unified_image_has_the_model_error_of_the_own_model_alone():
    """Bearings are the own model's, so what a conversion leaves is no error of them."""
    stated = {"sigma_px": 0.2, "length_px": 80.0}
    lens = camera_from_dict({**T265.to_dict(), "model_error": stated})
    assert unified_image(lens).camera.model_error == lens.model_error
    assert unified_image(T265).camera.model_error is None
    assert to_unified(lens).camera.model_error.sigma_px > 1.0


def test_a_pixel_without_a_bearing_is_named_and_one_that_does_not_count_is_left_out():
    lens = ended(T265, 80.0)
    image, pixels = unified_image(lens), np.array([[424.0, 404.0], [2.0, 2.0]])
    with pytest.raises(InputError, match=r"seen: \(2, 2\) at index 1 is outside .* \(at most 80.0° from"):
        image.inside("seen", pixels)
    assert image.kept(pixels, np.ones(2, dtype=bool))[1].tolist() == [True, False]
    with pytest.raises(InputError, match="given with a KannalaBrandt; legal: with a UnifiedCamera"):
        image.refuse_parameters("calibration_covariance")


SAME = {
    "eucm": (ExtendedUnified(200.0, 205.0, 320.0, 240.0, 0.6, 1.0, 640, 480), 0.6),
    "ds": (DoubleSphere(200.0, 205.0, 320.0, 240.0, 0.0, 0.6, 640, 480), 0.6),
}


@pytest.mark.parametrize("name", SAME)
def test_derivatives_are_those_of_the_same_camera_written_differently(name):
    lens, alpha = SAME[name]
    unified = UnifiedCamera(500.0, 512.5, 320.0, 240.0, alpha / (1.0 - alpha), 640, 480)
    rng = np.random.default_rng(1)
    points = rng.normal(size=(6, 50, 3)) + np.array([0.0, 0.0, 2.0])
    for ours, theirs in zip(lens.project_jacobian(points), unified.project_jacobian(points), strict=True):
        assert ours == pytest.approx(theirs, rel=1e-6, abs=1e-5, nan_ok=True)
    pixels = pixels_of(lens)
    found = lens.unproject_jacobian(pixels)
    for ours, theirs in zip(found, unified.unproject_jacobian(pixels), strict=True):
        assert ours == pytest.approx(theirs, rel=1e-5, abs=1e-8, nan_ok=True)


@pytest.mark.parametrize("name", PUBLISHED)
def test_derivatives_of_both_directions_are_inverse_on_the_sphere(name):
    lens = PUBLISHED[name]
    bearings, by_pixel, seen = lens.unproject_jacobian(pixels_of(lens))
    _, by_point, known = lens.project_jacobian(bearings[seen])
    product = by_point[known] @ by_pixel[seen][known]
    assert product == pytest.approx(np.broadcast_to(np.eye(2), product.shape), abs=2e-5)


def test_derivatives_do_not_exist_outside_the_domain():
    lens = ended(T265, 80.0)
    points = np.array([[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [math.sin(1.0), 0.0, math.cos(1.0)]])
    pixels, slopes, valid = lens.project_jacobian(points)
    assert valid.tolist() == [False, False, True]
    assert np.isnan(pixels[:2]).all()
    assert np.isnan(slopes[:2]).all()
    assert not lens.unproject_jacobian([[2.0, 2.0], [np.nan, 0.0]])[2].any()


def let_out(lens, margin):
    """How many rays of pixels just outside a lens's image lie inside its unified form's limits."""
    size, reach = np.array([lens.width, lens.height]), 15.0
    pixels = np.random.default_rng(0).uniform(-0.5 - reach, size - 0.5 + reach, (400_000, 2))
    rays, valid = lens.unproject(pixels[(pixels < -0.5).any(axis=1) | (pixels > size - 0.5).any(axis=1)])
    limits = unified_limits(lens).camera.image_limits(margin)
    return int((rays[valid] @ limits.normals.T <= limits.kappas).all(axis=1).sum())


@pytest.mark.parametrize("name", PUBLISHED)
def test_what_the_shrunk_limits_of_the_unified_form_show_is_in_the_camera_s_own_image(name):
    """The margin is the conversion's residual; polygons of distorted cameras leave out a little more."""
    lens = PUBLISHED[name]
    assert let_out(lens, unified_limits(lens).camera.deviation_px) == 0


def test_without_the_margin_the_unified_form_shows_what_a_camera_does_not():
    for name in ("RealSense T265, fisheye", "RealSense, colour", "TUM RGB-D, freiburg1, colour"):
        assert let_out(PUBLISHED[name], 0.0) > 0


def test_the_cost_is_told_in_four_numbers_with_what_can_be_done():
    told = to_unified(T265).cost
    for words in (r"3.87 px (1.57 deg) away, rms 2.87 px", "they keep 3.87 px more", "--max-angle DEG"):
        assert words in told
    assert "--max-angle" not in to_unified(ended(T265, 85.0)).cost
    assert "27% of the field lost" in to_unified(Equirectangular(1000, 500)).cost
    assert to_unified(preset("fe185")).cost == to_unified(SAME["ds"][0]).cost == ""


def test_the_page_has_the_table_s_rows():
    page = (Path(__file__).parents[2] / "docs" / "camera.md").read_text().splitlines()
    for name, lens in lenses():
        if name in PUBLISHED:
            assert f"| {row(name, lens)} |" in page
