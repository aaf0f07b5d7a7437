"""How uncertain the size of the structure's own ellipsoid is.

A point's covariance grows with its distance, and all distances follow the motion: where noise makes the
structure too near, its ellipsoid is too small in all 3n directions at once. With f the mean over those
directions of the logarithm of the covariance, the squared length of the error in that ellipsoid is χ²₃ₙ times
exp(f̂ − f), a factor of variance s² = Σₖ fₖ², fₖ what one σ of the motion along axis k does to f. Student's
law with ν' degrees of freedom has a factor of variance 2/ν', so 1/ν' = 1/ν + s²/2 has both.
"""

from __future__ import annotations

import math

import numpy as np

from omniservo.estimation.matches import Matches
from omniservo.estimation.refinement.epipolar_refinement import move_motion, tangent_plane
from omniservo.estimation.refinement.normal_blocks import empty_rows, linearise_point
from omniservo.estimation.uncertainty.likelihood_samples import structures
from omniservo.geometry.arrays import FloatArray
from omniservo.geometry.kernel import kernel


def size_variance(
    members: Matches,
    rotation: FloatArray,
    translation: FloatArray,
    covariance: FloatArray,
    between: tuple[int, int] | None,
) -> float:
    """Return s², the variance of the mean logarithm of the points' covariance.

    Args:
        members: the matches of the fit.
        rotation: (3, 3) the optimum.
        translation: (3,) the optimum, of length 1.
        covariance: (6, 6) of (t, δ), ‖t‖ = 1.
        between: members whose distance fixes the scale; None: ‖t‖ does.
    """
    tangents, basis, n = np.empty((2, 3)), np.zeros((6, 5)), members.size
    tangent_plane(translation, tangents)
    basis[3:, :3], basis[:3, 3:] = np.eye(3), tangents.T
    values, axes = np.linalg.eigh(basis.T @ covariance @ basis)
    steps = (axes * np.sqrt(np.maximum(values, 0.0))).T
    steps = np.concatenate((steps, -steps))
    rotations, translations = np.empty((10, 3, 3)), np.empty((10, 3))
    points, logarithms = np.empty((10, n, 3)), np.empty((10, n))
    for step, r, t in zip(steps, rotations, translations, strict=True):
        move_motion(rotation, translation, tangents, step, r, t)
    structures(*members[:4], rotations, translations, points)
    block_logarithms(*members[:3], rotations, translations, points, logarithms)
    gaps = logarithms[5:] - logarithms[:5]
    changes = 0.5 * np.where(np.isfinite(gaps), gaps, 0.0).sum(axis=1) / (3 * n)
    if between is not None:
        lengths = np.linalg.norm(points[:, between[0]] - points[:, between[1]], axis=1)
        changes -= np.log(lengths[:5] / lengths[5:])
    return float(np.sum(np.square(changes)))


@kernel
def block_logarithms(
    parameters: FloatArray,
    pixels: FloatArray,
    weights: FloatArray,
    rotations: FloatArray,
    translations: FloatArray,
    points: FloatArray,
    logarithms: FloatArray,
) -> None:
    """Write log det BᵀB (k, n), B (4, 3) a point's pixels by the point; NaN where it is not seen."""
    rows = empty_rows()
    b = rows.to_point
    for k in range(points.shape[0]):
        for j in range(points.shape[1]):
            logarithms[k, j] = math.nan
            r, t, h = rotations[k], translations[k], points[k]
            if not linearise_point(parameters, pixels, weights, j, r, t, h, rows):
                continue
            xx, xy, yy, xz, yz, zz = 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
            for i in range(4):
                xx, xy, yy = xx + b[i, 0] * b[i, 0], xy + b[i, 0] * b[i, 1], yy + b[i, 1] * b[i, 1]
                xz, yz, zz = xz + b[i, 0] * b[i, 2], yz + b[i, 1] * b[i, 2], zz + b[i, 2] * b[i, 2]
            size = xx * (yy * zz - yz * yz) - xy * (xy * zz - yz * xz) + xz * (xy * yz - yy * xz)
            if size > 0.0:
                logarithms[k, j] = math.log(size)
