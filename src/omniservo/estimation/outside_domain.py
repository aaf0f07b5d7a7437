"""Matches that say nothing: of pixels that the camera cannot have seen, and repetitions of others."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np

from omniservo.cameras.models import CentralModel
from omniservo.estimation.deferred import later
from omniservo.estimation.two_view_estimate import TwoViewEstimate
from omniservo.geometry.arrays import BoolArray, FloatArray, IntArray, owned


def in_domain(camera: CentralModel, *views: FloatArray) -> BoolArray | None:
    """Return the rows (n,) of pixels (n, 2) inside the camera's domain in all views; None where most are not.

    Then it is the camera, or the unit, that is wrong.
    """
    inside = np.logical_and.reduce([camera.unproject(pixels)[1] for pixels in views])
    return inside if 2 * np.count_nonzero(inside) >= len(inside) else None


def first_of_equal(pixels: FloatArray) -> IntArray:
    """Return of each row (n,) of pixels (n, 4) the first that is equal to it.

    Detectors that describe a place by several directions give a match as often as they have.
    """
    order = np.lexsort(pixels.T)  # stable: equal rows stay in the order of their numbers
    is_new = np.ones(len(order), dtype=np.bool_)
    is_new[1:] = (pixels[order[1:]] != pixels[order[:-1]]).any(axis=1)
    first = np.empty_like(order)
    first[order] = order[is_new][np.cumsum(is_new) - 1]
    return first


def with_rows(values: FloatArray, rows: BoolArray) -> FloatArray:
    """Return the values (m, …) of the chosen of n rows in their places, NaN in the others."""
    filled = np.full((len(rows), *values.shape[1:]), math.nan)
    filled[rows] = values
    return owned(filled)


def among_all(part: TwoViewEstimate, rows: BoolArray) -> TwoViewEstimate:
    """Return the estimate of the chosen of n matches as one of all, of which the others were rejected."""
    inliers = np.zeros(len(rows), dtype=np.bool_)
    inliers[rows] = part.inliers
    return replace(
        part,
        points=with_rows(part.points, rows),
        covariance=later(lambda: part.covariance),
        points_covariance=later(lambda: with_rows(part.points_covariance, rows)),
        inliers=inliers,
        residuals_px=with_rows(part.residuals_px, rows),
        uncertainty=later(lambda: part.uncertainty),
    )
