"""From the pixels of known points to the minima of the pixel cost, and to the points they rest on."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from omniservo.estimation.refinement.pose_minima import (
    COST,
    LEAST_WIDTH,
    MOST_MINIMA,
    pose_minima,
    principal_axes,
)
from omniservo.estimation.refinement.pose_refinement import minimise_pose
from omniservo.estimation.robust.pose_search import (
    GATE,
    choose_members,
    find_pose,
    grow_members,
    noise_of_all,
    sampling_threshold,
)
from omniservo.geometry.arrays import BoolArray, FloatArray

LEAST_POINTS = 3
CHECKED_POINTS = 4
"""Fewer points fit some pose whatever they are: they cannot tell a wrong one among them."""

FEW_POINTS = 12
"""Up to here all points are first fitted together, and sampled only if they do not agree."""

TELLING_POINTS = 8
"""From here on residuals tell noise of all points from wrong ones among them."""

UNSUSPICIOUS_NOISE_PX = 1.0
"""Few points can hide a wrong one in a bad pose; more noise than this makes them suspicious."""


@dataclass(frozen=True, eq=False)
class KnownPixels:
    """Known points with their pixels: rows of the kernels' arrays."""

    parameters: FloatArray
    """of the camera"""
    points: FloatArray
    """(n, 3) [m]"""
    pixels: FloatArray
    """(n, 2) [px]"""
    bearings: FloatArray
    """(n, 3)"""
    weights: FloatArray
    """(n,) of the residuals: a coordinate's σ is σ₀ over its weight"""
    noise_px: float | None
    """σ₀ [px]; None: not known"""

    def where(self, chosen: BoolArray) -> KnownPixels:
        """Return the chosen rows."""
        return KnownPixels(
            self.parameters,
            self.points[chosen],
            self.pixels[chosen],
            self.bearings[chosen],
            self.weights[chosen],
            self.noise_px,
        )


@dataclass(frozen=True, eq=False)
class PoseFit:
    """The minima of the pixel cost over the members."""

    members: BoolArray
    """(n,) points in the cost"""
    minima: FloatArray
    """(m, 8) of reference_T_camera, best first; a row's places are those of `pose_minima`"""
    is_collinear: bool
    """The members lie on one line; there are no minima then."""

    @property
    def costs(self) -> FloatArray:
        """Σ(wr)² [px²] of the minima (m,)."""
        return self.minima[:, COST]


def _all_are_noisy(known: KnownPixels, members: BoolArray, q: FloatArray, t: FloatArray) -> bool:
    """Tell whether more noise of all points explains them better than members and points that lie anywhere.

    A pose of few that chance has brought near their pixels leaves out the others, and says too little noise.
    """
    n, k = len(members), int(members.sum())
    rows = (known.parameters, known.points, known.pixels)
    q_all, t_all, cost, ok = minimise_pose(*rows, known.weights, math.inf, q, t)
    if not ok:
        return False
    sigma, farthest = noise_of_all(*rows, known.weights, 0.0, q_all, t_all)
    if farthest > GATE * sigma:
        return False
    weights = np.where(members, known.weights, 0.0)
    _, _, own, ok = minimise_pose(*rows, weights, math.inf, q, t)
    if not ok or k <= LEAST_POINTS:
        return ok
    area = float(np.prod(np.maximum(np.ptp(known.pixels, axis=0), 1.0)))
    one, other = (
        math.log(2.0 * math.pi * math.e * max(square, 1e-12) / (2 * m - 6))
        for square, m in ((cost, n), (own, k))
    )
    return n * one < k * other + (n - k) * math.log(area)


def fit_pose(known: KnownPixels, robust: bool) -> PoseFit:
    """Return the fit to all points or, robust, to those that agree."""
    n, noise = len(known.points), known.noise_px or 0.0
    members, minima = np.ones(n, dtype=np.bool_), np.empty((MOST_MINIMA, COST + 1))
    rows = (known.parameters, known.points, known.pixels)
    q, t, weights, middle, normal = np.zeros(4), np.zeros(3), known.weights, np.empty(3), np.empty(3)
    if principal_axes(known.points, weights, middle, normal)[0] < LEAST_WIDTH:
        return PoseFit(members, minima[:0], True)
    agreed = False
    if not robust or n <= FEW_POINTS:
        found = find_pose(*rows, known.bearings, weights, math.inf, q, t)
        agreed = not robust or n == LEAST_POINTS
        if found == n and not agreed:
            sigma, farthest = noise_of_all(*rows, weights, noise, q, t)
            agreed = farthest <= GATE * sigma and sigma <= max(UNSUSPICIOUS_NOISE_PX, noise)
    if not agreed:
        find_pose(*rows, known.bearings, weights, sampling_threshold(noise), q, t)
        count = choose_members(*rows, weights, noise, q, t, members)
        if CHECKED_POINTS <= count <= FEW_POINTS:
            count = grow_members(*rows, weights, noise, q, t, members)
        if TELLING_POINTS <= n > count and known.noise_px is None and _all_are_noisy(known, members, q, t):
            members[:], count = True, n
        if count < CHECKED_POINTS:
            return PoseFit(members, minima[:0], False)
        weights = np.where(members, weights, 0.0)
        if principal_axes(known.points, weights, middle, normal)[0] < LEAST_WIDTH:
            return PoseFit(members, minima[:0], True)
    count = pose_minima(*rows, known.bearings, weights, q, t, minima)
    return PoseFit(members, minima[:count], False)
