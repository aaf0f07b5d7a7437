"""Coordinates in which the valley of ξ, focal length and distortion is nearly straight.

With distortion free, α, κ1 and κ2 trade against each other along a curve on which the radial map
F(ω) = n + κ1 n³ + κ2 n⁵, n = sin ω/(α + (1−α) cos ω), stays nearly the same. Steps are straight, so they are
taken in (…, α, F(ω1), F(ω2), …): α moves while the map at two angles stays.
"""

from __future__ import annotations

import numpy as np

from omniservo.calibration.adjustment.lens import ALPHA, K1, K2, RADIAL, is_legal
from omniservo.geometry.arrays import BoolArray, FloatArray

_OUTER = 95.0
_INNER = 0.6
_LEAST_DENOMINATOR = 0.05


class Chart:
    """The coordinates for corners at some angles; θ itself where κ1 and κ2 are not both free."""

    def __init__(self, angles: FloatArray, free: BoolArray) -> None:
        outer = float(np.percentile(angles, _OUTER)) if len(angles) else 1.0
        self.angles = np.array([_INNER * outer, outer])
        self.bent = bool(free[ALPHA] and free[K1] and free[K2])

    def jacobian(self, theta: FloatArray) -> FloatArray:
        """Return ∂θ/∂coordinates (9, 9)."""
        J = np.eye(9)
        n = self._radii(theta[ALPHA])
        if not self.bent or n is None:
            return J
        k1, k2 = theta[RADIAL]
        by_alpha = -n * (1.0 - np.cos(self.angles)) / self._denominators(theta[ALPHA])
        inverse = np.linalg.inv(np.stack([n**3, n**5], 1))
        J[RADIAL, ALPHA] = -inverse @ (by_alpha * (1.0 + 3.0 * k1 * n**2 + 5.0 * k2 * n**4))
        J[RADIAL, RADIAL] = inverse
        return J

    def moved(self, theta: FloatArray, change: FloatArray) -> FloatArray:
        """Return θ after a ``change`` (9,) of the coordinates; NaN where no camera is there."""
        result = theta + change
        n, m = self._radii(theta[ALPHA]), self._radii(result[ALPHA])
        if not self.bent or n is None:
            return result
        if m is None:
            return np.full(9, np.nan)
        values = n + theta[K1] * n**3 + theta[K2] * n**5 + change[RADIAL]
        result[RADIAL] = np.linalg.solve(np.stack([m**3, m**5], 1), values - m)
        return result if is_legal(result) else np.full(9, np.nan)

    def _radii(self, alpha: float) -> FloatArray | None:
        depth = self._denominators(alpha)
        return None if depth.min() < _LEAST_DENOMINATOR else np.asarray(np.sin(self.angles) / depth)

    def _denominators(self, alpha: float) -> FloatArray:
        return np.asarray(alpha + (1.0 - alpha) * np.cos(self.angles))
