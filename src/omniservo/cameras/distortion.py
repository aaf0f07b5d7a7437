"""Where radial-tangential distortion stays one-to-one, in closed form.

D(m) = (1 + k1 r² + k2 r⁴) m + 2(q·m) m + r² q with q = (p2, p1) is the gradient of a potential, so its
Jacobian J is symmetric, and D is one-to-one on every convex set on which J is positive definite.
With a = 1 + 3 k1 r² + 5 k2 r⁴, b = 1 + k1 r² + k2 r⁴, Q = ‖q‖ and ψ the angle between m and q, in the
axes along and across m:

    J = [[a + 6 Q r cos ψ, 2 Q r sin ψ], [2 Q r sin ψ, b + 2 Q r cos ψ]]
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

Distortion = tuple[float, float, float, float]
"""(k1, k2, p1, p2)"""

_SHORT_OF_THE_FOLD = 1.0 - 1e-6
"""the usable disc ends this far before the fold, so that the inverse keeps ten digits"""


def largest_invertible_radius(distortion: Distortion) -> float:
    """Return the radius of the largest disc ‖m‖ ≤ r in which the distortion is safely one-to-one.

    det J = 16 Q²r² cos²ψ + 2 Q r (a + 3b) cos ψ + ab − 4 Q²r², minimised over ψ, first reaches 0 at the
    fold; the disc ends a millionth before it. Infinite where det J never reaches 0.
    """
    k1, k2, p1, p2 = distortion
    if not any(distortion):
        return math.inf
    q = math.hypot(p1, p2)
    opposed = [
        [1.0, -6.0 * q, 3.0 * k1, 0.0, 5.0 * k2],
        [1.0, -2.0 * q, k1, 0.0, k2],
    ]  # ψ = π: a − 6Qr, b − 2Qr
    folds = [r for polynomial in opposed for r in positive_roots(polynomial)]
    # between, at cos ψ = −(a + 3b)/(16 Q r): det J / r² as a cubic in r²
    cubic = [k1 - 4.0 * q * q, 0.75 * k1 * k1 + 2.0 * k2, 2.0 * k1 * k2, k2 * k2]
    oblique = [math.sqrt(s) for s in positive_roots(cubic)]
    folds += [r for r in oblique if abs(4.0 + 6.0 * k1 * r**2 + 8.0 * k2 * r**4) <= 16.0 * q * r]
    return min(folds, default=math.inf) * _SHORT_OF_THE_FOLD


def least_stretch(distortion: Distortion, radius: float) -> float:
    """Return a lower bound of J's eigenvalues over the disc ‖m‖ ≤ radius (finite).

    The two eigenvalues are at least min(a, b) − 6 Q r; a and b are quadratics in r².
    """
    k1, k2, p1, p2 = distortion
    s = radius * radius
    lowest = min(_least_quadratic(3.0 * k1, 5.0 * k2, s), _least_quadratic(k1, k2, s))
    return lowest - 6.0 * math.hypot(p1, p2) * radius


def largest_distorted_radius(distortion: Distortion, radius: float) -> float:
    """Return an upper bound of ‖D(m)‖ over the disc ‖m‖ ≤ radius, which must be one of invertibility."""
    k1, k2, p1, p2 = distortion
    if math.isinf(radius):
        return math.inf
    s = radius * radius
    return radius * (1.0 + k1 * s + k2 * s * s) + 3.0 * math.hypot(p1, p2) * s  # r b(r) grows: its slope is a


def _least_quadratic(linear: float, square: float, end: float) -> float:
    """Return the minimum of 1 + linear·s + square·s² over 0 ≤ s ≤ end."""
    at_end = 1.0 + end * (linear + end * square)
    if square > 0.0 and 0.0 < -linear < 2.0 * square * end:
        return 1.0 - linear * linear / (4.0 * square)
    return min(1.0, at_end)


def positive_roots(coefficients: Sequence[float]) -> list[float]:
    """Return the real roots r > 0 of Σ coefficients[i] rⁱ, found as 1/t because the high ones may vanish.

    A nearly double root counts as real, which errs to the safe side.
    """
    t = np.roots([0.0 if abs(c) < 1e-100 else c for c in coefficients])
    return [1.0 / float(x.real) for x in t if x.real > 1e-12 and abs(x.imag) <= 1e-7 * abs(x)]
