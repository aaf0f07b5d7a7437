"""Where a polynomial first vanishes, and tables of the inverse of a growing function."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence

import numpy as np

from omniservo.cameras.distortion import positive_roots
from omniservo.geometry.arrays import FloatArray

_HALVINGS = 60


def first_positive_root(coefficients: Sequence[float]) -> float:
    """Return the smallest real root x > 0 of Σ coefficients[i] xⁱ, or ∞; coefficients[0] > 0.

    As `positive_roots` has them.
    """
    return min(positive_roots(coefficients), default=math.inf)


def inverse_table(function: Callable[[FloatArray], FloatArray], end: float, steps: int) -> FloatArray:
    """Return the x (steps + 1,) in [0, end] at which a growing function takes equal steps from f(0) = 0.

    Each x lies within rounding of the true one, so that the table's intervals hold the roots between them.
    Behind them stand the slopes of x per step, (steps + 1,), of a cubic spline through them.
    """
    from scipy.interpolate import CubicSpline  # slow to import, and few cameras have polynomials

    wanted = np.linspace(0.0, float(function(np.array(end))), steps + 1)
    low, high = np.zeros(steps + 1), np.full(steps + 1, end)
    for _ in range(_HALVINGS):
        half = 0.5 * (low + high)
        below = function(half) < wanted
        low, high = np.where(below, half, low), np.where(below, high, half)
    table = 0.5 * (low + high)
    table[0], table[-1] = 0.0, end
    return np.concatenate([table, CubicSpline(np.arange(steps + 1.0), table)(np.arange(steps + 1.0), 1)])
