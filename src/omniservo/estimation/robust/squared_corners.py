"""Corners of squares under a motion: where they are squares, how sure that is, and how large they are.

See `square_evidence`.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from scipy.special import chdtrc

from omniservo.estimation.matches import Matches
from omniservo.estimation.refinement.motion_search import LEAST_NOISE_PX, Minimum
from omniservo.estimation.robust.members import MOTION_PARAMETERS
from omniservo.estimation.uncertainty.first_order import determines_motion, linear_response
from omniservo.geometry.arrays import FloatArray, IntArray

CONDITIONS = 5
"""of a square, see g above"""
PRINTED = 0.005
"""A print is a square but for so much of its side, and so is what a calibration makes of it."""

STEPS = 4
"""of Gauss-Newton on g"""

ALIKE = 0.05
ODD = 1e-3
"""Chances: above the first sizes are equal, below the second they are not."""


class Squared(NamedTuple):
    """Corners moved to where they are squares, at the least cost."""

    cost: float
    """[px²] that it takes"""
    corners: FloatArray
    """(m, 4, 3) in lengths of t"""
    spread: FloatArray
    """(12m, 12m) their covariance, for noise of 1 px over the weight"""


def squared(members: Matches, minimum: Minimum, squares: IntArray) -> Squared | None:
    """Return the corners of squares (m, 4) under a minimum; None where it leaves the motion free."""
    n = members.size
    arrays = (members.parameters, members.pixels, members.weights)
    solution = (minimum.rotation, minimum.translation, minimum.points)
    if len(squares) == 0 or not determines_motion(*arrays, *solution):
        return None
    rows, own = linear_response(*arrays, np.tile(np.eye(2).ravel(), (n, 2)), *solution, None).law()
    corners = squares.ravel()
    shared = rows[:, 6:].reshape(len(rows), n, 3)[:, corners].reshape(len(rows), -1)
    spread = shared.T @ shared
    for i, corner in enumerate(corners):
        spread[3 * i : 3 * i + 3, 3 * i : 3 * i + 3] += own[corner]
    variance = max(minimum.cost / max(n - MOTION_PARAMETERS, 1), members.noise_px**2, LEAST_NOISE_PX**2)
    slack = PRINTED**2 / variance * np.eye(CONDITIONS * len(squares))
    gain: FloatArray = np.zeros((len(spread), len(slack)))
    moved, cost = np.zeros(len(spread)), 0.0
    for _ in range(STEPS):
        gaps, slopes = square_gaps(minimum.points[squares] + moved.reshape(-1, 4, 3))
        missing = gaps - slopes @ moved
        gain = np.asarray(np.linalg.solve(slopes @ spread @ slopes.T + slack, slopes @ spread).T, float)
        moved = -gain @ missing
        cost = float(missing @ np.linalg.solve(slopes @ spread @ slopes.T + slack, missing))
    if not math.isfinite(cost):
        return None
    left = spread - gain @ (slopes @ spread)
    return Squared(max(cost, 0.0), minimum.points[squares] + moved.reshape(-1, 4, 3), left)


def odd_size(squares: Squared, variance: float) -> int | None:
    """Return the one square of another size than all others, for noise of so much variance [px²]."""
    a, b, _, d = np.swapaxes(squares.corners, 0, 1)
    u, v = b - a, d - a
    square, m = np.sum(u * u, axis=1) + np.sum(v * v, axis=1), len(u)
    slopes = np.zeros((m, m, 4, 3))
    for i in range(m):
        slopes[i, i, 1], slopes[i, i, 3], slopes[i, i, 0] = u[i], v[i], -u[i] - v[i]
    by_corners = slopes.reshape(m, -1) / square[:, None]
    covariance = variance * by_corners @ squares.spread @ by_corners.T + PRINTED**2 * np.eye(m)
    sizes = 0.5 * np.log(square)
    # Only differences: the size of the whole structure is uncertain, and the same for all.
    for k in range(m):
        others = [i for i in range(m) if i != k]
        contrasts = np.eye(m)[others[1:]] - np.eye(m)[others[0]]
        spread = contrasts @ covariance @ contrasts.T
        gaps = contrasts @ sizes
        alike = float(chdtrc(m - 2, gaps @ np.linalg.solve(spread, gaps)))
        mean = np.zeros(m)
        mean[others] = 1.0 / (m - 1)
        apart = np.eye(m)[k] - mean
        chance = float(chdtrc(1, (apart @ sizes) ** 2 / (apart @ covariance @ apart)))
        if alike >= ALIKE and chance * m < ODD:
            return k
    return None


def square_gaps(corners: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return g (5m,) of four corners each (m, 4, 3) and its derivative (5m, 12m), the sides e held."""
    m = len(corners)
    a, b, c, d = np.swapaxes(corners, 0, 1)
    u, v, gap = b - a, d - a, a - b + c - d
    square = 0.5 * (np.sum(u * u, axis=1) + np.sum(v * v, axis=1))
    side = np.sqrt(square)[:, None]
    sides, angle = 0.5 * np.sum(u * u - v * v, axis=1) / square, np.sum(u * v, axis=1) / square
    gaps = np.column_stack((gap / side, sides, angle))
    slopes = np.zeros((m, CONDITIONS, m, 4, 3))
    signs = np.array([1.0, -1.0, 1.0, -1.0])
    for i in range(m):
        for k in range(3):
            slopes[i, k, i, :, k] = signs / side[i]
        slopes[i, 3, i, 1], slopes[i, 3, i, 3] = u[i] / square[i], -v[i] / square[i]
        slopes[i, 4, i, 1], slopes[i, 4, i, 3] = v[i] / square[i], u[i] / square[i]
        slopes[i, 3:, i, 0] = -slopes[i, 3:, i, 1] - slopes[i, 3:, i, 3]
    return gaps.ravel(), slopes.reshape(CONDITIONS * m, 12 * m)
