"""Image limits are cones: they agree with pixels, point by point."""

import math

import numpy as np
import pytest

from omniservo.cameras import UnifiedCamera, preset
from omniservo.errors import InputError

EDGES = ("domain", "left edge", "right edge", "top edge", "bottom edge")


@pytest.fixture(scope="module")
def many_rays():
    directions = np.random.default_rng(11).normal(size=(100_000, 3))
    return directions * np.random.default_rng(12).uniform(0.1, 10, (100_000, 1))


def inside_cones(limits, points):
    distance = np.linalg.norm(points, axis=1, keepdims=True)
    return points @ limits.normals.T <= limits.kappas * distance


def test_cones_agree_with_pixels_on_every_ray(plain_camera, many_rays):
    camera = plain_camera
    limits = camera.image_limits()
    assert limits.names == EDGES + (("max_angle",) if camera.max_angle is not None else ())
    assert limits.polygon is None
    assert limits.dead_zone == camera.dead_zone
    pixels, valid = camera.project(many_rays)
    u, v = np.nan_to_num(pixels, nan=-1e9).T
    in_rectangle = (u >= -0.5) & (u <= camera.width - 0.5) & (v >= -0.5) & (v <= camera.height - 0.5)
    assert (inside_cones(limits, many_rays).all(axis=1) == (valid & in_rectangle)).all()


def test_without_the_domain_the_edges_alone_would_admit_folded_points(many_rays):
    camera = UnifiedCamera(296.9365, 298.4197, 316.8076, 254.9012, 1.2910, 659, 432)
    cones = inside_cones(camera.image_limits(), many_rays)
    folded = cones[:, 1:].all(axis=1) & ~cones[:, 0]
    assert 0.04 < folded.mean() < 0.055


def test_edge_limit_with_margin_is_the_line_moved_inwards(plain_camera, many_rays):
    limits = plain_camera.image_limits(7.5)
    pixels, valid = plain_camera.project(many_rays)
    u, v = pixels[valid].T
    cones = inside_cones(limits, many_rays[valid])
    w, h = plain_camera.width, plain_camera.height
    expected = np.stack([u >= 7.0, u <= w - 8.0, v >= 7.0, v <= h - 8.0], axis=1)
    assert (cones[:, 1:5] == expected).all()


@pytest.mark.parametrize("margin", [0.0, 0.5, 20.0])
def test_points_inside_the_circle_with_margin_are_that_far_inside_in_pixels(margin):
    for camera in (
        preset("fe185"),
        preset("hyper-catadioptric"),
        UnifiedCamera(300, 220, 320, 240, 0.8, 640, 480, skew=40.0, max_angle=1.7),
    ):
        limits = camera.image_limits(margin)
        angle = math.acos(-limits.kappas[limits.names.index("max_angle")])
        assert angle <= camera.max_angle
        azimuth = np.linspace(0, 2 * np.pi, 721)

        def circle(a, azimuth=azimuth, camera=camera):
            c = np.stack(
                [np.sin(a) * np.cos(azimuth), np.sin(a) * np.sin(azimuth), np.cos(a) + 0 * azimuth], 1
            )
            return camera.project(c)[0]

        inner, outer = circle(angle), circle(camera.max_angle)
        distance = np.linalg.norm(inner[:, None] - outer[None], axis=2).min()
        assert distance >= margin - 1e-9
        assert distance <= margin + 0.05 * margin + 0.02


def test_dead_zone_grows_by_the_margin():
    camera = preset("para-catadioptric")
    zone = camera.image_limits(5.0).dead_zone
    assert zone.center == camera.dead_zone.center
    assert zone.radius == camera.dead_zone.radius + 5.0


@pytest.mark.parametrize("margin", [-1.0, math.nan, 216.0, 1e9, "2"])
def test_margin_that_is_none_or_leaves_nothing_is_refused(margin):
    with pytest.raises(InputError, match="margin_px"):
        preset("fe185").image_limits(margin)


def test_margin_that_uses_up_the_circle_is_refused():
    camera = UnifiedCamera(100, 100, 320, 240, 0.0, 640, 480, max_angle=0.2)
    assert camera.image_limits(20.0).names[-1] == "max_angle"
    with pytest.raises(InputError, match="max_angle"):
        camera.image_limits(20.3)


def test_largest_angle_at_or_past_the_domain_adds_no_tighter_cone():
    for xi in (0.0, 0.8, 1.0):
        camera = UnifiedCamera(300, 300, 320, 240, xi, 640, 480, max_angle=math.pi)
        limits = camera.image_limits(3.0)
        assert limits.kappas[-1] == pytest.approx(limits.kappas[0], abs=1e-14)
    fisheye = UnifiedCamera(300, 300, 320, 240, 1.5, 640, 480, max_angle=math.pi)
    assert fisheye.image_limits(3.0).kappas[-1] < fisheye.image_limits().kappas[-1]


def test_arrays_are_read_only_and_finite(camera):
    limits = camera.image_limits(1.0)
    assert np.isfinite(limits.normals).all()
    assert np.isfinite(limits.kappas).all()
    assert len(limits.names) == len(limits.kappas) == len(limits.normals)
    with pytest.raises(ValueError, match="read-only"):
        limits.kappas[0] = 1.0
