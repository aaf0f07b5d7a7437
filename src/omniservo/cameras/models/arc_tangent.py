"""The arc tangent in a form without branches, which a compiler turns into vector instructions."""

import math

import numpy as np

from omniservo.geometry.kernel import inlined

_TERMS = 12
_LARGEST = math.tan(math.pi / 8.0)


def _coefficients() -> tuple[float, ...]:
    """Return the c_k of arctan t = Σ c_k t^(2k+1) on |t| ≤ p = tan π/8, the last one first.

    arctan(p s) = 2 Σ (−1)^k q^(2k+1)/(2k+1) T_(2k+1)(s) on |s| ≤ 1 with q = tan π/16; what is left
    out is below q²⁵ = 3·10⁻¹⁸.
    """
    series = np.zeros(2 * _TERMS)
    for k in range(_TERMS):
        series[2 * k + 1] = 2.0 * (-1.0) ** k * math.tan(math.pi / 16.0) ** (2 * k + 1) / (2 * k + 1)
    powers = np.polynomial.chebyshev.cheb2poly(series)
    return tuple(float(powers[n] / _LARGEST**n) for n in range(2 * _TERMS - 1, 0, -2))


_C = _coefficients()


@inlined
def arc_tangent(y: float, x: float) -> float:
    """Return atan2(y, x) [rad] to 10⁻¹⁵; 0 at (0, 0), and NaN where x or y is.

    The smaller of |x|, |y| over the larger is an angle up to π/4, that or the rest to π/4 one up to π/8.
    """
    ax, ay = abs(x), abs(y)
    small, large = (ax, ay) if ay > ax else (ay, ax)
    near = small > _LARGEST * large
    above, below = (small - large, small + large) if near else (small, large)
    t = above / (below if below != 0.0 else 1.0)
    s = t * t
    odd = 0.0
    for c in _C:
        odd = odd * s + c
    angle = t * odd + (0.25 * math.pi if near else 0.0)
    angle = 0.5 * math.pi - angle if ay > ax else angle
    angle = math.pi - angle if x < 0.0 else angle
    return -angle if y < 0.0 else angle
