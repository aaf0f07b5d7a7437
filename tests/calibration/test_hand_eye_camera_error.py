"""The camera's stated error, the same in every view, is part of where the camera sits on the flange."""

import numpy as np
import pytest
from scipy.stats import chi2
from tests.calibration.hand_eye_scenes import FISHEYE, FLANGE_T_CAMERA, PINHOLE, draw_views, error_of

from omniservo.calibration.hand_eye import calibrate_hand_eye
from omniservo.cameras import ModelError, UnifiedCamera
from omniservo.cameras.calibration_covariance import covariance_directions

ROOT = np.diag([1.5, 1.5, 1.0, 1.0, 0.01]) @ np.random.default_rng(40).normal(size=(5, 5))
COVARIANCE = ROOT @ ROOT.T
FIELD = ModelError(0.3, 0.2 * FISHEYE.width)
STATED = UnifiedCamera.from_dict(
    {**FISHEYE.to_dict(), "calibration_covariance": COVARIANCE, "model_error": FIELD.to_dict()}
)
RUNS, VIEWS = 10, 10


def drawn(rng, change):
    """Views of a robot that errs, in a camera with other parameters and a smooth error."""
    fx, fy, cx, cy, xi = np.array([FISHEYE.fx, FISHEYE.fy, FISHEYE.cx, FISHEYE.cy, FISHEYE.xi]) + change
    camera = UnifiedCamera(fx, fy, cx, cy, xi, FISHEYE.width, FISHEYE.height)
    views = draw_views(rng, camera, VIEWS, position=3e-4, rotation=np.radians(0.03))
    moves = FIELD.moves(np.concatenate(views.pixels))
    field = np.einsum("f,fnc->nc", rng.standard_normal(len(moves)), moves)
    ends = np.cumsum([len(pixels) for pixels in views.pixels])[:-1]
    views.pixels[:] = [p + e for p, e in zip(views.pixels, np.split(field, ends), strict=True)]
    return views


@pytest.mark.slow
def test_the_covariance_holds_a_camera_that_is_off_as_it_states():
    directions, rng, held = covariance_directions(COVARIANCE), np.random.default_rng(5), []
    for _ in range(RUNS):
        views = drawn(rng, rng.standard_normal(len(directions)) @ directions)
        found = calibrate_hand_eye(STATED, views.base_T_flange, views.pixels, views.points)
        error = error_of(found.flange_T_camera, FLANGE_T_CAMERA)
        held.append([error @ np.linalg.solve(found.covariance, error) < chi2.ppf(p, 6) for p in (0.5, 0.95)])
    half, nearly_all = np.mean(held, axis=0)
    assert 0.25 <= half <= 0.75
    assert nearly_all >= 0.9


@pytest.mark.slow
@pytest.mark.parametrize("name", ["calibration_covariance", "model_error"])
def test_each_part_of_a_cameras_error_makes_the_mount_less_certain(name):
    views = draw_views(np.random.default_rng(6), FISHEYE, VIEWS, position=3e-4, rotation=np.radians(0.03))
    stated = UnifiedCamera.from_dict({**FISHEYE.to_dict(), name: STATED.to_dict()[name]})
    mounts = [
        calibrate_hand_eye(camera, views.base_T_flange, views.pixels, views.points).covariance
        for camera in (FISHEYE, stated)
    ]
    assert np.trace(mounts[1][:3, :3]) > 2.0 * np.trace(mounts[0][:3, :3])


@pytest.mark.parametrize("seed", [6, 16])
def test_where_the_camera_is_off_by_far_more_than_the_robot_views_are_weighed_as_the_covariance_says(seed):
    """Weighed as if the robot were off by what the camera is, the truth was outside the 99.9% ellipsoid."""
    covariance = np.diag([16.0, 16.0, 1.0, 1.0, 1e-5])
    covariance[0, 1] = covariance[1, 0] = 15.0
    numbers, size = np.array([500.0, 500.0, 319.5, 239.5, 1.0]), (PINHOLE.width, PINHOLE.height)
    stated = UnifiedCamera(*numbers, *size, calibration_covariance=covariance)
    rng = np.random.default_rng(seed)
    true = UnifiedCamera(*(numbers + np.linalg.cholesky(covariance) @ rng.standard_normal(5)), *size)
    views = draw_views(rng, true, 16, position=1e-5, rotation=2e-5)
    found = calibrate_hand_eye(stated, views.base_T_flange, views.pixels, views.points)
    error = error_of(found.flange_T_camera, FLANGE_T_CAMERA)
    assert error @ np.linalg.solve(found.covariance, error) < chi2.ppf(0.999, 6)
