"""Where the model, the lens and the distortion end."""

import math

import mpmath
import numpy as np
import pytest

from omniservo.cameras import UnifiedCamera, preset
from omniservo.cameras.distortion import (
    largest_distorted_radius,
    largest_invertible_radius,
    least_stretch,
)


def distort(d, x, y):
    k1, k2, p1, p2 = d
    r2 = x * x + y * y
    radial = 1 + k1 * r2 + k2 * r2 * r2
    return x * radial + 2 * p1 * x * y + p2 * (r2 + 2 * x * x), y * radial + p1 * (
        r2 + 2 * y * y
    ) + 2 * p2 * x * y


def jacobian(d, x, y):
    """By complex steps, independent of the closed form."""
    h = 1e-30
    ux, vx = distort(d, x + 1j * h, y + 0j)
    uy, vy = distort(d, x + 0j, y + 1j * h)
    return np.stack([np.stack([ux.imag, uy.imag], -1), np.stack([vx.imag, vy.imag], -1)], -2) / h


def on_circle(radius, n=720):
    a = np.linspace(0, 2 * np.pi, n, endpoint=False)
    return radius * np.cos(a), radius * np.sin(a)


@pytest.mark.parametrize("xi", [1.05, 1.291, 2.2134, 5.0])
def test_fisheye_rim_is_at_minus_one_over_xi(xi):
    camera = UnifiedCamera(300, 300, 320, 240, xi, 640, 480)
    assert camera.usable_angle == pytest.approx(math.acos(-1 / xi), abs=1e-12)
    below, above = -1 / xi - 1e-9, -1 / xi + 1e-9
    points = np.array([[math.sqrt(1 - z * z), 0.0, z] for z in (below, above)])
    assert camera.project(points)[1].tolist() == [False, True]
    rim = 300 / math.sqrt(xi * xi - 1)
    pixels = np.array([[320 + rim * (1 + 1e-9), 240], [320 + rim * (1 - 1e-9), 240], [320, 240 - rim]])
    assert camera.unproject(pixels)[1].tolist() == [False, True, True]


@pytest.mark.parametrize("xi", [0.0, 0.3, 0.8, 0.97])
def test_mirror_domain_ends_at_minus_xi_and_takes_every_pixel(xi):
    camera = UnifiedCamera(300, 300, 320, 240, xi, 640, 480)
    points = np.array([[math.sqrt(1 - z * z), 0.0, z] for z in (-xi, -xi - 1e-9, -xi + 1e-9)])
    assert camera.project(points)[1].tolist()[1:] == [False, True]
    bearings, valid = camera.unproject(np.array([[1e9, 240.0], [320.0, -1e7]]))
    assert valid.all()
    assert (bearings[:, 2] > -xi - 1e-15).all()


def test_plane_of_a_perspective_camera_is_outside():
    camera = preset("perspective")
    assert not camera.project([1.0, 0.0, 0.0])[1]
    assert not camera.project([0.0, 0.0, -1.0])[1]
    assert camera.project([1.0, 0.0, 1e-9])[1]


def test_parabolic_mirror_sees_everything_but_straight_back():
    camera = UnifiedCamera(300, 300, 320, 240, 1.0, 640, 480)
    assert not camera.project([0.0, 0.0, -1.0])[1]
    assert camera.project([1e-3, 0.0, -1.0])[1]


def test_point_behind_the_fisheye_does_not_fold_into_the_image():
    """172° from the axis the bare formula lands inside the image of the paper's camera."""
    camera = UnifiedCamera(296.9365, 298.4197, 316.8076, 254.9012, 1.2910, 659, 432)
    a, azimuth = math.radians(172), math.radians(-21)
    point = np.array([math.sin(a) * math.cos(azimuth), math.sin(a) * math.sin(azimuth), math.cos(a)])
    d = point[2] + camera.xi
    u, v = camera.fx * point[0] / d + camera.cx, camera.fy * point[1] / d + camera.cy
    assert d > 0
    assert camera.in_image([u, v])
    assert not camera.project(point)[1]


def test_largest_angle_is_inclusive_and_nothing_beyond_it_is_seen():
    for angle in (math.pi / 2, math.radians(92.5), 0.3):
        camera = UnifiedCamera(300, 300, 320, 240, 1.291, 659, 432, max_angle=angle)
        assert camera.usable_angle == angle
        at = np.array([[math.sin(a), 0.0, math.cos(a)] for a in (angle, angle + 1e-12, angle - 1e-12)])
        at[0, 2] = 0.0 if angle == math.pi / 2 else at[0, 2]
        assert camera.project(at)[1].tolist() == [True, False, True]
        r = math.sin(angle) / (math.cos(angle) + camera.xi)
        pixels = [[320 + 300 * r * (1 + e), 240] for e in (1e-10, -1e-10)]
        assert camera.unproject(pixels)[1].tolist() == [False, True]


def test_largest_angle_beyond_the_domain_changes_nothing():
    free = UnifiedCamera(300, 300, 320, 240, 1.291, 659, 432)
    wide = UnifiedCamera(300, 300, 320, 240, 1.291, 659, 432, max_angle=math.pi)
    assert wide.usable_angle == free.usable_angle
    assert np.array_equal(wide.parameters, free.parameters)


def test_bearing_agrees_with_fifty_digits_up_to_the_rim():
    mpmath.mp.dps = 50
    for xi in (0.0, 0.8, 1.0, 1.291, 2.2134):
        camera = UnifiedCamera(256.0, 256.0, 0.0, 0.0, xi, 640, 480)
        limit = 1 / math.sqrt(xi * xi - 1) if xi > 1 else 50.0
        for share in (0.0, 1e-6, 0.3, 0.9, 1 - 1e-9):
            u = 256.0 * limit * share
            x, big_xi = mpmath.mpf(u) / 256, mpmath.mpf(xi)
            r2 = x * x
            root = mpmath.sqrt(1 + (1 - big_xi**2) * r2)
            eta = (big_xi + root) / (1 + r2)
            expected = [float(eta * x), 0.0, float(eta - big_xi)]
            bearing, valid = camera.unproject([u, 0.0])
            assert valid
            # at the rim 1 + (1−ξ²)r² cancels: its rounding, 1e-16/root, is all that is lost
            assert np.abs(bearing - expected).max() < 1e-15 + 1e-16 / float(root)


@pytest.mark.parametrize("seed", range(40))
def test_distortion_is_invertible_up_to_the_fold_and_not_beyond(seed):
    rng = np.random.default_rng(seed)
    scale = 10 ** rng.uniform(-2, 0.5)
    d = rng.normal(size=4) * scale * [1, 1, 0.3 * rng.random() ** 3, 0.3 * rng.random() ** 3]
    if seed % 4 == 0:
        d[2:] = 0
    if seed % 5 == 0:
        d[1] = 0
    radius = largest_invertible_radius(tuple(d))
    for share in np.linspace(0, 1, 60):
        x, y = on_circle(min(radius, 30.0) * share)
        assert np.linalg.eigvalsh(jacobian(d, x, y)).min() > 0
    if radius < 30:
        x, y = on_circle(radius * (1 + 2e-4), 7200)
        assert np.linalg.det(jacobian(d, x, y)).min() < 1e-3 * scale


def test_fold_of_pure_radial_distortion_is_the_root_of_the_derivative():
    radius = largest_invertible_radius((-0.3, 0.0, 0.0, 0.0))
    assert radius == pytest.approx(1 / math.sqrt(0.9), rel=2e-6)
    assert largest_invertible_radius((0.1, 0.2, 0.0, 0.0)) == math.inf
    assert largest_invertible_radius((0.0, 0.0, 0.0, 0.0)) == math.inf
    assert largest_invertible_radius((0.0, 0.0, 0.01, 0.0)) == pytest.approx(1 / 0.06, rel=2e-6)
    assert largest_invertible_radius((0.0, 1e-300, 0.0, 1e-200)) == math.inf


@pytest.mark.parametrize("seed", range(10))
def test_bounds_over_a_disc_hold(seed):
    d = tuple(np.random.default_rng(seed).normal(size=4) * [0.3, 0.3, 0.01, 0.01])
    radius = min(0.95 * largest_invertible_radius(d), 1.0)
    worst, furthest = math.inf, 0.0
    for share in np.linspace(0, 1, 100):
        x, y = on_circle(radius * share, 90)
        worst = min(worst, np.linalg.eigvalsh(jacobian(d, x, y)).min())
        furthest = max(furthest, np.hypot(*distort(d, x, y)).max())
    assert least_stretch(d, radius) <= worst
    assert least_stretch(d, radius) >= worst - 16 * math.hypot(*d[2:]) * radius - 1e-3
    assert furthest <= largest_distorted_radius(d, radius) <= 1.1 * furthest + 6 * math.hypot(*d[2:])


def test_pixel_beyond_the_fold_is_not_valid_and_costs_no_wrong_answer():
    """Past r(1 − 0.35 r²)'s maximum the polynomial returns: the same pixel has a second, false solution."""
    camera = UnifiedCamera(300, 300, 320, 240, 0.0, 640, 480, distortion=(-0.35, 0.0, 0.0, 0.0))
    fold = 1 / math.sqrt(1.05)
    assert camera.usable_angle == pytest.approx(math.atan(fold), abs=1e-5)
    peak = fold * (1 - 0.35 * fold**2)
    pixels = np.array([[320 + 300 * peak * s, 240] for s in (0.5, 0.9999, 1.0001, 2.0)])
    bearings, valid = camera.unproject(pixels)
    assert valid.tolist() == [True, True, False, False]
    assert (np.hypot(bearings[:2, 0], bearings[:2, 1]) / bearings[:2, 2] < fold).all()
    beyond = np.array([1.2 * fold, 0.0, 1.0])
    assert not camera.project(beyond)[1]


def test_distorted_round_trip_holds_right_up_to_the_fold():
    camera = UnifiedCamera(300, 300, 320, 240, 0.6, 640, 480, distortion=(-0.35, 0.02, 2e-3, 1e-3))
    limit = camera.usable_angle
    azimuth = np.linspace(0, 2 * np.pi, 361)
    for gap in (1e-2, 1e-4, 1e-6, 1e-8):
        a = limit - gap
        points = np.stack(
            [math.sin(a) * np.cos(azimuth), math.sin(a) * np.sin(azimuth), 0 * azimuth + math.cos(a)], 1
        )
        pixels, valid = camera.project(points)
        bearings, seen = camera.unproject(pixels)
        assert valid.all()
        assert seen.all()
        assert np.abs(camera.project(bearings)[0] - pixels).max() < 1e-9
        assert np.abs(bearings - points).max() < 1e-8
