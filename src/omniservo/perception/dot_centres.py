"""From the image of a circle to the image of its centre.

The image of a circle's centre is not the centroid of the circle's image: the ray to the centre is not the
axis of the cone, and the lens magnifies unevenly. On the plane that touches the unit sphere at the dot the
cone is an exact ellipse; its two families of circular sections give two possible circles, hence two
centres, one on each side of the cone's axis. One image of one dot cannot tell them apart; several dots of
one size on a surface can, because their distances say how the surface lies.
"""

from __future__ import annotations

import numpy as np

from omniservo.cameras.models import CentralModel
from omniservo.geometry.arrays import BoolArray, FloatArray, IntArray

# Seven points and weights in the unit disc, exact for polynomials of degree 5 (Stroud, S2: 5-1).
_ANGLES = np.arange(6) * np.pi / 3
_NODES = np.vstack([[0.0, 0.0], np.sqrt(2 / 3) * np.stack([np.cos(_ANGLES), np.sin(_ANGLES)], 1)])
_WEIGHTS = np.array([0.25] + [0.125] * 6)

NEIGHBOURS = 6
OUT_OF_PLANE = np.deg2rad(30.0)
"""a neighbour farther out of the dot's plane does not belong to its surface"""
DECIDE = np.deg2rad(10.0)
"""[rad] by so much the sum over the neighbours must be smaller for one circle than for the other"""


def circle_centres(camera: CentralModel, centroids: FloatArray, covariance: FloatArray) -> FloatArray:
    """Return the image (n, 2) [px] of the centre of each circle, given the moments of its image.

    Where the neighbours decide between the two circles, it is the centre of the right one. Else it is the
    ray half-way between the two centres, about (r/d)²/2 rad off at worst (r radius, d distance; at 45°
    of tilt). A dot whose outline the camera cannot unproject keeps its centroid.

    Args:
        camera: the camera that took the image.
        centroids: (n, 2) [px] centroid of each dot's image.
        covariance: (n, 2, 2) [px²] its second central moments.
    """
    if not len(centroids):
        return np.zeros((0, 2))
    frames, centre, spread, valid = tangent_ellipses(camera, centroids, covariance)
    bearings, normals, distance = circles(frames, centre, spread)
    middle = _unit(bearings.sum(1))
    side = _side_by_neighbours(middle * distance[:, None], normals, valid)
    chosen = np.where((side < 0)[:, None], middle, bearings[np.arange(len(side)), np.maximum(side, 0)])
    pixels, projected = camera.project(np.where(valid[:, None], chosen, [0.0, 0.0, 1.0]))
    return np.where((valid & projected)[:, None], pixels, centroids)


def tangent_ellipses(
    camera: CentralModel, centroids: FloatArray, covariance: FloatArray
) -> tuple[FloatArray, FloatArray, FloatArray, BoolArray]:
    """Return each dot as an ellipse on the plane that touches the unit sphere at its centroid.

    The ellipse is the one whose image has the given moments, found by fixed-point steps; the moments of an
    ellipse's image are integrals over the ellipse with the camera's Jacobian determinant as density.

    Returns:
        frames (n, 3, 3), columns x, y and the bearing of the centroid; centre (n, 2) and covariance (n, 2,
        2) of the ellipse on the plane z = 1 of the frame; valid (n,), False where the camera does not see
        all of it.
    """
    bearings, valid = camera.unproject(centroids)
    bearings = np.where(valid[:, None], bearings, [0.0, 0.0, 1.0])
    frames = _frames(bearings)
    _, jacobian, seen = camera.project_jacobian(bearings)
    valid = valid & seen
    step = np.linalg.inv(np.where(valid[:, None, None], jacobian @ frames[:, :, :2], np.eye(2)))
    centre = np.zeros_like(centroids)
    spread = step @ covariance @ step.swapaxes(1, 2)
    for _ in range(3):
        mean, moments, seen = _image_moments(camera, frames, centre, spread)
        valid = valid & seen
        miss = np.where(valid[:, None], centroids - mean, 0.0)
        bend = np.where(valid[:, None, None], covariance - moments, 0.0)
        centre = centre + (step @ miss[:, :, None])[:, :, 0]
        spread = spread + step @ bend @ step.swapaxes(1, 2)
    smallest = np.linalg.eigvalsh(spread)[:, 0]
    valid = valid & (smallest > 0)
    return frames, centre, np.where(valid[:, None, None], spread, np.eye(2) * 1e-4), valid


def circles(
    frames: FloatArray, centre: FloatArray, spread: FloatArray
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return the two circles of radius 1 whose cone has the given ellipse on the tangent plane.

    With the cone xᵀQx = 0, eigenvalues λ₁ ≥ λ₂ > 0 > λ₃ and unit eigenvectors e₁, e₂, e₃ (e₃ towards the
    dot), g = √((λ₁−λ₂)/(λ₁−λ₃)) and h = √((λ₂−λ₃)/(λ₁−λ₃)), the circles have normal ±g·e₁ + h·e₃ and centre
    z₀(±(λ₃/λ₂)·g·e₁ + (λ₁/λ₂)·h·e₃), z₀ = λ₂/√(−λ₁λ₃).

    Returns:
        bearings (n, 2, 3) of the two centres, normals (n, 2, 3), distance (n,) of both centres in radii.
    """
    inverse = np.linalg.inv(4.0 * spread)
    cone = np.zeros((len(spread), 3, 3))
    shifted = (inverse @ centre[:, :, None])[:, :, 0]
    cone[:, :2, :2] = inverse
    cone[:, :2, 2] = cone[:, 2, :2] = -shifted
    cone[:, 2, 2] = (centre * shifted).sum(1) - 1.0
    values, vectors = np.linalg.eigh(cone)
    l3, l2, l1 = values.T
    e3, e1 = vectors[:, :, 0], vectors[:, :, 2]
    e3 = e3 * np.where(e3[:, 2:] < 0, -1.0, 1.0)
    g = np.sqrt(np.maximum(l1 - l2, 0.0) / (l1 - l3))
    h = np.sqrt((l2 - l3) / (l1 - l3))
    scale = l2 / np.sqrt(-l1 * l3)
    across, along = (scale * l3 / l2 * g)[:, None] * e1, (scale * l1 / l2 * h)[:, None] * e3
    centres = np.stack([along + across, along - across], 1)
    normals = np.stack([g[:, None] * e1 + h[:, None] * e3, -g[:, None] * e1 + h[:, None] * e3], 1)
    distance = np.linalg.norm(centres[:, 0], axis=1)
    rotate = frames[:, None]
    bearings = (rotate @ _unit(centres)[..., None])[..., 0]
    return bearings, (rotate @ normals[..., None])[..., 0], distance


def _image_moments(
    camera: CentralModel, frames: FloatArray, centre: FloatArray, spread: FloatArray
) -> tuple[FloatArray, FloatArray, BoolArray]:
    root = 2.0 * _cholesky(spread)
    flat = centre[:, None] + _NODES @ root.swapaxes(1, 2)
    points = (frames[:, None, :, :2] @ flat[..., None])[..., 0] + frames[:, None, :, 2]
    pixels, jacobian, seen = camera.project_jacobian(points)
    weight = _WEIGHTS * np.abs(np.linalg.det(jacobian @ frames[:, None, :, :2]))
    weight = weight / weight.sum(1, keepdims=True)
    mean = (weight[..., None] * pixels).sum(1)
    off = pixels - mean[:, None]
    return mean, (weight[..., None] * off).swapaxes(1, 2) @ off, np.asarray(seen.all(1))


def _cholesky(matrix: FloatArray) -> FloatArray:
    a = np.sqrt(np.maximum(matrix[:, 0, 0], 1e-30))
    b = matrix[:, 1, 0] / a
    c = np.sqrt(np.maximum(matrix[:, 1, 1] - b * b, 0.0))
    return np.stack([a, np.zeros_like(a), b, c], 1).reshape(-1, 2, 2)


def _side_by_neighbours(points: FloatArray, normals: FloatArray, valid: BoolArray) -> IntArray:
    """Which of the two circles (0, 1) lies in one surface with its neighbours; -1: undecided.

    Of a dot on a board most neighbours lie in its plane, others beyond a ridge do not: the angles between
    the plane and the directions to the neighbours are summed, each cut off at OUT_OF_PLANE.
    """
    side = np.full(len(points), -1, dtype=np.int64)
    index = np.flatnonzero(valid)
    for i in index if len(index) > 2 else []:
        off = points[index] - points[i]
        gaps = np.linalg.norm(off, axis=1)
        order = np.argsort(gaps, kind="stable")[1:NEIGHBOURS]
        near = order[gaps[order] <= 2.2 * gaps[order[0]]]
        sines = np.abs(off[near] @ normals[i].T) / np.maximum(gaps[near], 1e-12)[:, None]
        angles = np.minimum(np.arcsin(np.minimum(sines, 1.0)), OUT_OF_PLANE)
        total = angles.sum(0)
        best = int(np.argmin(total))
        if total[1 - best] - total[best] >= DECIDE and angles[:, best].min() < 0.5 * OUT_OF_PLANE:
            side[i] = best
    return side


def _frames(bearings: FloatArray) -> FloatArray:
    least = np.eye(3)[np.argmin(np.abs(bearings), axis=1)]
    x = _unit(np.cross(least, bearings))
    return np.stack([x, np.cross(bearings, x), bearings], 2)


def _unit(vectors: FloatArray) -> FloatArray:
    return np.asarray(vectors / np.linalg.norm(vectors, axis=-1, keepdims=True))
