"""OpenCV's omnidir module as an independent implementation, and a value of Mei's own toolbox."""

import json

import cv2
import numpy as np
import pytest

from omniservo.cameras import UnifiedCamera


def test_projection_agrees_with_omnidir(camera, rays):
    """`cv2.omnidir.projectPoints` takes no account of the domain: compared inside it only."""
    points = rays * 2.5
    pixels, valid = camera.project(points)
    theirs, _ = cv2.omnidir.projectPoints(
        points[None, :], np.zeros(3), np.zeros(3), camera.matrix, camera.xi, np.array([camera.distortion])
    )
    near = valid & (np.abs(np.nan_to_num(pixels)).max(axis=1) < 5000)  # beyond, rounding alone is larger
    assert near.sum() > 0.2 * len(rays)
    assert np.abs(theirs[0] - pixels)[near].max() <= 1e-9


def test_distortion_agrees_with_the_plain_opencv_model(rays):
    camera = UnifiedCamera(420.0, 430.0, 320.0, 240.0, 0.0, 640, 480, distortion=(-0.28, 0.07, 1e-3, -5e-4))
    rays = rays[rays[:, 2] > 0.3]
    pixels, valid = camera.project(rays)
    theirs, _ = cv2.projectPoints(
        rays[valid], np.zeros(3), np.zeros(3), camera.matrix, np.array(camera.distortion)
    )
    assert np.abs(theirs[:, 0] - pixels[valid]).max() < 1e-9


def test_unprojection_agrees_with_omnidir_where_that_converges(rays):
    camera = UnifiedCamera(420.0, 430.0, 320.0, 240.0, 0.9, 640, 480, distortion=(-0.02, 0.004, 1e-3, -5e-4))
    pixels, valid = camera.project(rays[rays[:, 2] > 0.5])
    theirs = cv2.omnidir.undistortPoints(
        pixels[valid][None], camera.matrix, np.array([camera.distortion]), np.array([camera.xi]), np.eye(3)
    )[0]
    bearings, _ = camera.unproject(pixels[valid])
    assert np.abs(bearings[:, :2] / bearings[:, 2:] - theirs).max() < 1e-6


def test_a_value_of_meis_toolbox(shared_data):
    golden = json.loads((shared_data / "calibrations/mei_toolbox/mei_toolbox_golden.json").read_text())
    camera = UnifiedCamera(
        golden["fx"],
        golden["fy"],
        golden["cx"],
        golden["cy"],
        golden["xi"],
        640,
        480,
        skew=golden["skew"],
        distortion=[golden[k] for k in ("k1", "k2", "p1", "p2")],
    )
    pixel, valid = camera.project(golden["X"])
    assert valid
    assert pixel == pytest.approx(golden["pixel"], abs=1e-9)
