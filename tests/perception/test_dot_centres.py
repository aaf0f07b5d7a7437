"""The circle's centre from the moments of its image, against moments integrated over the circle."""

import dot_scenes
import numpy as np
import pytest
from dot_scenes import plane_axes

from omniservo.cameras import UnifiedCamera
from omniservo.perception.dot_centres import circle_centres, circles, tangent_ellipses

CAMERAS = {
    "fisheye": dot_scenes.paper_camera(),
    "perspective": UnifiedCamera(600, 610, 320, 240, 0.0, 640, 480),
    "parabolic": UnifiedCamera(260, 260, 320, 240, 1.0, 640, 480),
    "mirrored": dot_scenes.paper_camera(fy=-298.4197),
    "skewed": UnifiedCamera(300, 280, 320, 240, 0.8, 640, 480, skew=4.0),
}
RADIUS = 0.01


def circle(off_axis, azimuth, tilt, lean, distance=0.2):
    """Centre and normal of a circle."""
    off, turn = np.deg2rad(off_axis), np.deg2rad(azimuth)
    sight = np.array([np.sin(off) * np.cos(turn), np.sin(off) * np.sin(turn), np.cos(off)])
    frame = plane_axes(-sight, np.deg2rad(lean))
    return distance * sight, np.cos(np.deg2rad(tilt)) * frame[:, 2] + np.sin(np.deg2rad(tilt)) * frame[:, 0]


def moments(camera, centre, normal):
    """Centroid and second moments of the circle's image by brute-force integration over the circle."""
    axes = plane_axes(normal)
    shells = np.sqrt((np.arange(200) + 0.5) / 200) * RADIUS
    turns = (np.arange(360) + 0.5) * 2 * np.pi / 360
    rim = np.cos(turns)[:, None] * axes[:, 0] + np.sin(turns)[:, None] * axes[:, 1]
    points = centre + (shells[:, None, None] * rim).reshape(-1, 3)
    pixels, jacobian, _ = camera.project_jacobian(points)
    weight = np.abs(np.linalg.det(jacobian @ axes[:, :2]))
    weight /= weight.sum()
    mean = weight @ pixels
    return mean, ((pixels - mean) * weight[:, None]).T @ (pixels - mean)


@pytest.mark.parametrize("name", CAMERAS)
@pytest.mark.parametrize("tilt", [0.0, 30.0, 60.0])
def test_one_of_the_two_circles_is_the_true_one(name, tilt):
    camera = CAMERAS[name]
    for off_axis, azimuth, lean in [(0, 0, 10), (15, 40, 100), (22, 200, 250)]:
        centre, normal = circle(off_axis, azimuth, tilt, lean)
        mean, spread = moments(camera, centre, normal)
        frames, middle, ellipse, valid = tangent_ellipses(camera, mean[None], spread[None])
        bearings, normals, distance = circles(frames, middle, ellipse)
        off = np.linalg.norm(camera.project(bearings[0])[0] - camera.project(centre)[0], axis=1)
        best = off.argmin()
        assert valid.all()
        assert off[best] < 2e-3
        assert abs(normals[0, best] @ normal) > np.cos(np.deg2rad(1.0))
        assert distance[0] * RADIUS == pytest.approx(np.linalg.norm(centre), rel=2e-4)


def test_at_the_rim_too():
    camera = CAMERAS["fisheye"]
    centre, normal = circle(85, 180, 40, 70)
    mean, spread = moments(camera, centre, normal)
    bearings, _, _ = circles(*tangent_ellipses(camera, mean[None], spread[None])[:3])
    off = np.linalg.norm(camera.project(bearings[0])[0] - camera.project(centre)[0], axis=1)
    assert off.min() < 2e-3
    assert np.linalg.norm(mean - camera.project(centre)[0]) > 0.1


def test_alone_a_dot_gets_the_point_between_the_two_centres():
    camera = CAMERAS["fisheye"]
    mean, spread = moments(camera, *circle(20, 0, 45, 0))
    found = circle_centres(camera, mean[None], spread[None])[0]
    bearings, _, _ = circles(*tangent_ellipses(camera, mean[None], spread[None])[:3])
    ends = camera.project(bearings[0])[0]
    assert np.linalg.norm(found - ends.mean(0)) < 0.01
    assert np.linalg.norm(ends[0] - ends[1]) > 0.2


def test_a_dot_that_the_camera_cannot_unproject_keeps_its_centroid():
    camera = CAMERAS["fisheye"]
    outside, shape = np.array([[2.0, 3.0], [317.0, 255.0]]), np.tile(4.0 * np.eye(2), (2, 1, 1))
    found = circle_centres(camera, outside, shape)
    assert found[0] == pytest.approx(outside[0])
    assert found[1] == pytest.approx(outside[1], abs=0.05)


def test_no_dots_give_no_centres():
    assert circle_centres(CAMERAS["fisheye"], np.zeros((0, 2)), np.zeros((0, 2, 2))).shape == (0, 2)
