"""OpenCV as an independent implementation of Kannala–Brandt and pinhole, where it is right.

Where it is not: its pinhole and fisheye calls divide by Z and project points behind the camera as if they lay
in front, and know no fold; `cv2.undistortPoints` and `cv2.fisheye.undistortPoints` stop after five and ten
steps unless told otherwise, and where the iteration leaves the domain return a number instead of a failure.
"""

import cv2
import numpy as np
import pytest

from omniservo.cameras import UnifiedCamera
from omniservo.cameras.models import KannalaBrandt, Pinhole

KB = (0.0034823894022493434, 0.0007150348452162257, -0.0020532361418706202, 0.00020293673591811182)
ALL = (-0.28, 0.07, 1e-3, -5e-4, 0.01, 0.1, 0.02, 0.003, 1e-3, 2e-3, -1e-3, 5e-4, 0.02, -0.03)
TIGHT = (cv2.TERM_CRITERIA_COUNT | cv2.TERM_CRITERIA_EPS, 500, 1e-14)
ZERO = np.zeros(3)


def matrix(camera):
    return np.array([[camera.fx, 0, camera.cx], [0, camera.fy, camera.cy], [0, 0, 1.0]])


def rays_in_front(camera, n=20_000):
    """Return rays of the image's pixels."""
    rng = np.random.default_rng(1)
    pixels = rng.uniform(-0.5, [camera.width - 0.5, camera.height - 0.5], (n, 2))
    rays, valid = camera.unproject(pixels)
    ahead = valid & (rays[:, 2] > 0.05)
    return rays[ahead] * rng.uniform(0.1, 10.0, (ahead.sum(), 1)), pixels[ahead]


@pytest.mark.parametrize("fy", [191.0, -191.0])
@pytest.mark.parametrize("skew", [0.0, 1.5])
def test_kannala_brandt_is_cv2_fisheye_in_front_of_the_camera(fy, skew):
    """OpenCV's alpha is skew/fx."""
    camera = KannalaBrandt(190.0, fy, 255.0, 256.0, 512, 512, k=KB, skew=skew)
    points, pixels = rays_in_front(camera)
    theirs, _ = cv2.fisheye.projectPoints(
        points[:, None], ZERO, ZERO, matrix(camera), np.array(KB), alpha=skew / 190.0
    )
    assert np.abs(theirs[:, 0] - camera.project(points)[0]).max() <= 1e-9
    if skew == 0.0:
        plane = cv2.fisheye.undistortPoints(pixels[:, None], matrix(camera), np.array(KB), criteria=TIGHT)
        rays = np.column_stack([plane[:, 0], np.ones(len(plane))])
        assert np.abs(camera.project(rays)[0] - pixels).max() <= 1e-9


def test_cv2_fisheye_folds_what_is_behind_the_camera_and_we_do_not():
    camera = KannalaBrandt(190.0, 191.0, 255.0, 256.0, 512, 512, k=KB)
    behind = np.array([[0.8, 0.1, -0.6]])
    theirs, _ = cv2.fisheye.projectPoints(behind[None], ZERO, ZERO, matrix(camera), np.array(KB))
    ours, valid = camera.project(behind)
    assert valid.all()
    assert np.hypot(*(ours - [255.0, 256.0])[0]) > 190.0 * np.pi / 2 * 0.9  # beyond the 90° ring
    assert np.hypot(*(theirs[0, 0] - [255.0, 256.0])) < 190.0 * np.pi / 2  # on the wrong side of it


@pytest.mark.parametrize("count", [0, 4, 5, 8, 12, 14])
def test_pinhole_is_cv2_project_points_with_every_length_of_distortion(count):
    camera = Pinhole(420.0, -421.0, 320.0, 240.0, 640, 480, distortion=ALL[:count])
    points, pixels = rays_in_front(camera)
    theirs, _ = cv2.projectPoints(points, ZERO, ZERO, matrix(camera), np.array(ALL[:count]))
    ours, valid = camera.project(points)
    assert valid.all()
    assert np.abs(theirs[:, 0] - ours).max() <= 1e-9
    distortion = np.array(ALL[:count])
    undistort = getattr(cv2, "undistortPointsIter", cv2.undistortPoints)  # OpenCV 5 has one function for both
    plane = undistort(pixels[:, None], matrix(camera), distortion, R=None, P=None, criteria=TIGHT)[:, 0]
    rays, _ = camera.unproject(pixels)
    back = camera.project(np.column_stack([plane, np.ones(len(plane))]))[0]
    converged = np.abs(back - pixels).max(axis=1) <= 1e-9
    assert converged.mean() > 0.6
    assert np.abs(rays[:, :2] / rays[:, 2:] - plane)[converged].max() <= 1e-9


@pytest.mark.parametrize("tilt", [(0.3, 0.0), (0.0, 0.3), (-0.2, 0.25)])
def test_a_tilted_sensor_is_opencvs(tilt):
    distortion = (*ALL[:12], *tilt)
    camera = Pinhole(420.0, 421.0, 320.0, 240.0, 640, 480, distortion=distortion)
    points, _ = rays_in_front(camera)
    theirs, _ = cv2.projectPoints(points, ZERO, ZERO, matrix(camera), np.array(distortion))
    assert np.abs(theirs[:, 0] - camera.project(points)[0]).max() <= 1e-9


def test_the_usable_disc_of_a_pinhole_ends_where_the_distortion_folds():
    """For radial distortion alone the fold is the first root of 1 + 3k1r² + 5k2r⁴ + 7k3r⁶."""
    k1, k2, k3 = -0.3, 0.05, -0.01
    camera = Pinhole(300.0, 300.0, 320.0, 240.0, 640, 480, distortion=(k1, k2, 0.0, 0.0, k3))
    squares = np.roots([7 * k3, 5 * k2, 3 * k1, 1.0])
    fold = np.sqrt(squares[(np.abs(squares.imag) < 1e-12) & (squares.real > 0)].real.min())
    assert np.tan(camera.usable_angle) == pytest.approx(fold, rel=1e-5)
    assert np.tan(camera.usable_angle) < fold
    assert camera.warnings


def test_unified_unprojection_is_cv2_omnidirs_past_90_degrees():
    """`cv2.omnidir` gives points of Z = 1, so beyond 90° only its projection can be compared."""
    camera = UnifiedCamera(400.0, 405.0, 320.0, 240.0, 1.5, 640, 480, distortion=(-0.1, 0.02, 1e-3, -5e-4))
    rng = np.random.default_rng(2)
    pixels = rng.uniform(-0.5, [639.5, 479.5], (20_000, 2))
    rays, valid = camera.unproject(pixels)
    assert (rays[valid, 2] < 0).any()
    theirs, _ = cv2.omnidir.projectPoints(
        rays[valid][None], ZERO, ZERO, camera.matrix, camera.xi, np.array([camera.distortion])
    )
    assert np.abs(theirs[0] - pixels[valid]).max() <= 1e-9
