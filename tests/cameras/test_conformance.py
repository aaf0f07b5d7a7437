"""What every camera promises: both directions, the domain from both sides, derivatives."""

import math

import numpy as np
import pytest

from omniservo.cameras import UnifiedCamera


def formula(camera, points):
    """(2), distortion and K in NumPy, without any domain."""
    x, y, z = np.moveaxis(points, -1, 0)
    d = z + camera.xi * np.linalg.norm(points, axis=-1)
    mx, my = x / d, y / d
    k1, k2, p1, p2 = camera.distortion
    r2 = mx**2 + my**2
    radial = 1 + k1 * r2 + k2 * r2**2
    dx = mx * radial + 2 * p1 * mx * my + p2 * (r2 + 2 * mx**2)
    dy = my * radial + p1 * (r2 + 2 * my**2) + 2 * p2 * mx * my
    return np.stack([camera.fx * dx + camera.skew * dy + camera.cx, camera.fy * dy + camera.cy], axis=-1)


def at_angle(angle, azimuth):
    return np.stack(
        [np.sin(angle) * np.cos(azimuth), np.sin(angle) * np.sin(azimuth), np.cos(angle) + 0 * azimuth],
        axis=-1,
    )


def angle_of(bearings):
    return np.arctan2(np.hypot(bearings[..., 0], bearings[..., 1]), bearings[..., 2])


def image_pixels(camera, n=4000, seed=0):
    rng = np.random.default_rng(seed)
    edge = np.array([camera.width, camera.height]) - 0.5
    inside = rng.uniform([-0.5, -0.5], edge, (n, 2))
    border = rng.uniform(0, 1, (n // 4, 1)) * (edge + 0.5) - 0.5
    border[:, 0] = np.where(rng.random(n // 4) < 0.5, -0.5, border[:, 0])
    return np.vstack([inside, border, [[-0.5, -0.5], edge, [camera.cx, camera.cy]]])


def test_projection_is_the_formula_inside_the_domain(camera, rays):
    points = rays * np.random.default_rng(1).uniform(1e-3, 1e3, (len(rays), 1))
    pixels, valid = camera.project(points)
    assert valid.any()
    error = np.abs(pixels - formula(camera, points))[valid]
    assert (error <= 1e-10 * (1 + np.abs(pixels[valid]))).all()
    assert np.isnan(pixels[~valid]).all()


def test_validity_is_the_angle_from_the_axis(camera, rays):
    angle = angle_of(rays)
    valid = camera.project(rays)[1]
    clear = np.abs(angle - camera.usable_angle) > 1e-7
    assert (valid == (angle < camera.usable_angle))[clear].all()


def test_pixel_to_bearing_to_pixel_returns(camera):
    pixels = image_pixels(camera)
    bearings, valid = camera.unproject(pixels)
    assert valid.sum() > 0.3 * len(pixels)
    assert np.abs(np.linalg.norm(bearings[valid], axis=1) - 1).max() < 1e-12
    again, seen = camera.project(bearings[valid])
    assert seen.all()
    assert np.abs(again - pixels[valid]).max() <= 1e-9
    assert np.isnan(bearings[~valid]).all()


def test_bearing_to_pixel_to_bearing_returns_over_the_whole_domain(camera):
    rng = np.random.default_rng(2)
    limit = min(camera.usable_angle, math.pi - 1e-3)
    angle = np.concatenate([rng.uniform(0, limit, 4000), limit * (1 - np.logspace(-3, -9, 400)), [0.0]])
    points = at_angle(angle, rng.uniform(0, 2 * np.pi, len(angle)))
    pixels, valid = camera.project(points)
    assert valid.all()
    bearings, seen = camera.unproject(pixels)
    far = np.abs(pixels).max(axis=1) > 1e6  # ξ ≤ 1 near its rim: the image is infinite
    assert seen[~far].all()
    error = np.linalg.norm(bearings - points, axis=1)
    rim = (limit - angle) / limit
    # on the rim the inverse has an infinite (fisheye) or a very large (fold) derivative
    assert error[(rim > 1e-2) & ~far].max() < 1e-9
    assert error[~far].max() < 1e-5


def test_points_just_inside_and_just_outside_the_domain(camera):
    if camera.usable_angle == math.pi:
        pytest.skip("only the direction straight back is outside")
    azimuth = np.linspace(0, 2 * np.pi, 73)
    inside = at_angle(camera.usable_angle - 1e-7, azimuth)
    outside = at_angle(camera.usable_angle + 1e-7, azimuth)
    assert camera.project(inside)[1].all()
    assert not camera.project(outside)[1].any()


def test_pixels_just_inside_and_just_outside_the_domain(camera):
    azimuth = np.linspace(0, 2 * np.pi, 73)
    rim = formula(camera, at_angle(camera.usable_angle - 1e-6, azimuth))
    if np.abs(rim).max() > 1e5:
        pytest.skip("the image of the rim is at infinity")
    center = np.array([camera.cx, camera.cy])
    assert camera.unproject(center + (1 - 1e-4) * (rim - center))[1].all()
    assert not camera.unproject(center + (1 + 1e-4) * (rim - center))[1].any()


def test_the_domain_does_not_depend_on_distance(camera, rays):
    valid = camera.project(rays)[1]
    for scale in (1e-6, 3.0, 1e9):
        assert (camera.project(rays * scale)[1] == valid).mean() > 0.9999


def test_projection_jacobian_is_the_finite_difference(camera, rays):
    points = 0.7 * rays[:500]
    far_in = camera.usable_angle * 0.95
    points = np.vstack([points[angle_of(points) < far_in], [[0, 0, 0.5], [1e-9, 0, 1.0]]])
    pixels, jacobian, valid = camera.project_jacobian(points)
    assert valid.all()
    assert np.array_equal(pixels, camera.project(points)[0])
    h = 1e-6
    for i in range(3):
        step = np.zeros(3)
        step[i] = h
        numeric = (camera.project(points + step)[0] - camera.project(points - step)[0]) / (2 * h)
        scale = np.abs(jacobian).max(axis=(1, 2))[:, None]
        curvature = 1 + (np.abs(pixels - [camera.cx, camera.cy]).max(axis=1, keepdims=True) / 100) ** 2
        assert (np.abs(jacobian[:, :, i] - numeric) <= 1e-7 * scale * curvature).all()


def test_unprojection_jacobian_is_the_finite_difference(camera):
    pixels = image_pixels(camera, 400, seed=3)
    bearings, _ = camera.unproject(pixels)
    pixels = np.vstack([pixels[angle_of(bearings) < 0.95 * camera.usable_angle], [[camera.cx, camera.cy]]])
    bearings, jacobian, valid = camera.unproject_jacobian(pixels)
    assert valid.all()
    assert np.abs(bearings - camera.unproject(pixels)[0]).max() < 1e-15
    h = 1e-3
    for i in range(2):
        step = np.zeros(2)
        step[i] = h
        numeric = (camera.unproject(pixels + step)[0] - camera.unproject(pixels - step)[0]) / (2 * h)
        scale = np.abs(jacobian).max(axis=(1, 2))[:, None]
        assert (np.abs(jacobian[:, :, i] - numeric) <= 1e-5 * scale).all()


def test_the_two_jacobians_are_inverse_on_the_sphere(camera):
    pixels = image_pixels(camera, 400, seed=4)
    bearings, down, valid = camera.unproject_jacobian(pixels)
    valid &= angle_of(bearings) < 0.95 * camera.usable_angle
    up = camera.project_jacobian(bearings[valid])[1]
    assert np.abs(up @ down[valid] - np.eye(2)).max() < 1e-8
    assert np.abs(np.einsum("ni,nij->nj", bearings[valid], down[valid])).max() < 1e-12


def test_leading_axes_broadcast(camera, rays):
    points = rays[:24].reshape(2, 3, 4, 3)
    pixels, valid = camera.project(points)
    flat, flat_valid = camera.project(points.reshape(-1, 3))
    assert pixels.shape == (2, 3, 4, 2)
    assert valid.shape == (2, 3, 4)
    assert np.array_equal(pixels.reshape(-1, 2), flat, equal_nan=True)
    assert np.array_equal(valid.reshape(-1), flat_valid)
    bearings, jacobian, _ = camera.unproject_jacobian(pixels)
    assert bearings.shape == (2, 3, 4, 3)
    assert jacobian.shape == (2, 3, 4, 3, 2)
    assert camera.project_jacobian(points)[1].shape == (2, 3, 4, 2, 3)
    single, single_valid = camera.project(points[0, 0, 0])
    assert single.shape == (2,)
    assert single_valid.shape == ()
    assert camera.project(np.empty((0, 3)))[0].shape == (0, 2)
    assert camera.in_image(pixels).shape == (2, 3, 4)


def test_other_layouts_and_types_of_the_same_numbers_give_the_same(camera):
    points = np.array([[1.0, 2.0, 5.0], [-1.0, 0.0, 3.0]])
    expected = camera.project(points)[0]
    for same in (np.asfortranarray(points), points.astype(np.float32), points.astype(int), points.tolist()):
        assert np.array_equal(camera.project(same)[0], expected)
    assert np.array_equal(camera.project(np.repeat(points, 2, axis=0)[::2])[0], expected)


def test_not_a_number_is_not_valid_and_does_not_spread(camera):
    points = np.array([[np.nan, 0, 1], [np.inf, 0, 1], [0, 0, 0], [0, 0, 1e200], [0.0, 0.0, 1.0]])
    pixels, valid = camera.project(points)
    assert valid.tolist() == [False, False, False, False, True]
    assert np.isnan(pixels[:4]).all()
    assert np.isnan(camera.project_jacobian(points)[1][:4]).all()
    bad = np.array([[np.nan, 0], [np.inf, 0], [1e300, 1e300], [camera.cx, camera.cy]])
    assert camera.unproject(bad)[1].tolist() == [False, False, False, True]
    assert camera.unproject_jacobian(bad)[2].tolist() == [False, False, False, True]
    assert not camera.in_image(bad[:3]).any()


def test_image_is_the_rectangle_from_minus_one_half(camera):
    w, h = camera.width, camera.height
    corners = np.array([[-0.5, -0.5], [w - 0.5, -0.5], [-0.5, h - 0.5], [w - 0.5, h - 0.5]])
    assert camera.in_image(corners).all()
    outwards = np.array([[-1, 0], [1, 0], [0, 1], [1, 1]]) * 1e-6
    assert not camera.in_image(corners + outwards).any()


def test_the_dictionary_gives_an_equal_camera(camera):
    again = UnifiedCamera.from_dict(camera.to_dict())
    assert again == camera
    assert hash(again) == hash(camera)
    assert again.to_dict() == camera.to_dict()
    assert np.array_equal(again.parameters, camera.parameters)
