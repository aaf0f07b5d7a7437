"""Natural features in raw wide-angle images: SIFT on the planes tangent to the sphere of view."""

from __future__ import annotations

import cv2
import numpy as np
from scipy.spatial import cKDTree

from omniservo.cameras.models import CentralModel
from omniservo.geometry.arrays import BoolArray, ByteArray, FloatArray
from omniservo.perception.features import Features
from omniservo.perception.field_views import FieldView, field_views
from omniservo.perception.find_dots import check_image
from omniservo.perception.image_points import ImagePoints
from omniservo.perception.tangent_patches import TangentFrames

MOST = 4000
"""the strongest are kept"""
CONTRAST = 0.02
"""SIFT's threshold; its usual 0.04 leaves dull surfaces without features"""
CLEARANCE = 4.0
"""in scales: nearer to the border of what the image shows, the border is part of the feature"""
LOCATION_ERROR = 0.08
"""standard deviation of a location, in scales"""
LEAST_ERROR = 0.07
"""[px] standard deviation of the best location"""


def find_features(image: ByteArray, camera: CentralModel) -> Features:
    """Find what can be found again from elsewhere: SIFT features of perspective views all round.

    A wide-angle lens draws the same corner differently in every part of the image. Each direction is
    therefore viewed in the perspective view whose axis is nearest to it, of the image's resolution
    there, and what is found is mapped back through the camera. So it works at any angle from the axis.

    Covariance: the error of a location grows with the scale (Zeisl et al., "Estimation of Location
    Uncertainty for Scale Invariant Feature Points", BMVC 2009); here it is `LOCATION_ERROR` scales on the
    view's plane, mapped into the image, and not less than `LEAST_ERROR` px.

    Args:
        image: (height, width) grey values, uint8.
        camera: the camera that took the image.

    Raises:
        InputError: not such an image, or not of the camera's size.
    """
    check_image(image, camera)
    found = [_in_view(camera, image, view) for view in field_views(camera)]
    rows = np.concatenate([np.zeros((0, 135)), *found])
    return _features(camera, rows[np.argsort(-rows[:, -1], kind="stable")])


def _in_view(camera: CentralModel, image: ByteArray, view: FieldView) -> FloatArray:
    """Features (n, 135) of a view's own: bearing (3), axis (3), descriptor (128), strength."""
    # without the last flag, places are shifted by a quarter of a pixel
    sift = cv2.SIFT.create(contrastThreshold=CONTRAST, enable_precise_upscale=True)
    mask = (view.own & (view.room > CLEARANCE)).astype(np.uint8)
    keys, histograms = sift.detectAndCompute(view.image(image), mask)
    if not keys:
        return np.zeros((0, 135))
    pixels = np.array([k.pt for k in keys])
    scale = np.array([0.5 * k.size for k in keys])
    angle = np.radians([k.angle for k in keys])
    heading = np.stack([np.cos(angle), np.sin(angle)], axis=1)
    places = view.places(pixels)
    rays, ahead = (view.frame.directions(p[None])[0] for p in (places, places + 1e-4 * heading))
    distance = np.linalg.norm(rays, axis=1, keepdims=True)
    bearings = rays / distance
    along = ahead - rays
    along -= (along * bearings).sum(1, keepdims=True) * bearings
    # seen from the centre, the plane is farther off by the distance, and slanted: one more, in one direction
    length = scale / view.focal / distance[:, 0] ** 1.5
    along *= (length / np.linalg.norm(along, axis=1))[:, None]
    columns, rows = np.rint(pixels).astype(int).T
    kept = view.room[rows, columns] > CLEARANCE * scale
    roots = np.sqrt(histograms / np.maximum(histograms.sum(axis=1, keepdims=True), 1.0))
    return np.asarray(np.column_stack([bearings, along, roots, [k.response for k in keys]])[kept])


def _features(camera: CentralModel, rows: FloatArray) -> Features:
    """Features of the rows that the camera sees, each once, the strongest `MOST`."""
    bearings = rows[:, :3] / np.linalg.norm(rows[:, :3], axis=1, keepdims=True)
    pixels, seen = camera.project(bearings)
    jacobians = TangentFrames.at(bearings).jacobians(camera)
    size = np.linalg.norm(rows[:, 3:6], axis=1)
    spread = size[:, None, None] * jacobians
    scale = np.sqrt(np.abs(np.linalg.det(np.where(np.isfinite(spread), spread, 0.0))))
    good = seen & np.isfinite(spread).all((1, 2)) & camera.in_image(np.where(seen[:, None], pixels, -1e6))
    rows, bearings, pixels, scale, spread = (a[good] for a in (rows, bearings, pixels, scale, spread))
    once = np.flatnonzero(_first_of_its_kind(pixels, scale, rows[:, 3:6]))[:MOST]
    covariance = LOCATION_ERROR**2 * spread @ np.swapaxes(spread, 1, 2) + LEAST_ERROR**2 * np.eye(2)
    return Features(
        ImagePoints(pixels[once], covariance[once]),
        rows[once, 6:-1].astype(np.float32), scale[once], bearings[once], rows[once, 3:6],
    )  # fmt: skip


def _first_of_its_kind(pixels: FloatArray, scale: FloatArray, axes: FloatArray) -> BoolArray:
    """False for a feature that a neighbouring view has shown, too: same place, scale and orientation."""
    first = np.ones(len(pixels), dtype=np.bool_)
    if len(pixels) < 2:
        return first
    i, j = cKDTree(pixels).query_pairs(1.5, output_type="ndarray").T
    length = np.linalg.norm(axes, axis=1)
    turned = (axes[i] * axes[j]).sum(1) / (length[i] * length[j])
    same = (np.abs(np.log(scale[i] / scale[j])) < 0.3) & (turned > 0.9)
    near = np.linalg.norm(pixels[i] - pixels[j], axis=1) < 0.5 * np.minimum(scale[i], scale[j])
    first[np.maximum(i, j)[same & near]] = False
    return first
