"""Polynomials on [0, 1] in the Bernstein basis, with a bound on every rounding error.

p(w) = Σ bₖ C(n,k) wᵏ (1−w)ⁿ⁻ᵏ. The smallest bₖ bounds p from below on [0, 1] and halving the interval
makes that bound converge. Errors are counted: a result with ``count`` c and magnitude S differs from the
exact one by at most c · UNIT · S. The counts are derived in docs/certificate.md.
"""

import math

import numpy as np

from omniservo.geometry.arrays import FloatArray
from omniservo.geometry.kernel import kernel, leaf

MAX_DEGREE = 54
"""Up to here every binomial coefficient, and every product C(m,i) C(n,k−i), is exact in a float."""

UNIT = 1.12e-16
"""The unit roundoff 2⁻⁵³ and 0.9% more, which swallows every second-order term."""

TINY = 1e-290
"""Added to every bound: what gradual underflow can lose."""

BINOMIALS: FloatArray = np.array(
    [[float(math.comb(n, k)) for k in range(MAX_DEGREE + 1)] for n in range(MAX_DEGREE + 1)]
)
"""C(n, k) at [n, k], 0 where k > n."""


@kernel
def bernstein_from_power(coefficients: FloatArray) -> FloatArray:
    """Return the Bernstein coefficients (m, n+1) of polynomials given by powers, highest first (m, n+1).

    bᵢ = Σₖ C(i,k)/C(n,k) aₖ, aₖ the factor of wᵏ. Count n + 2, magnitude Σₖ |aₖ|.
    """
    rows, n = coefficients.shape[0], coefficients.shape[1] - 1
    controls = np.zeros((rows, n + 1))
    for i in range(n + 1):
        for k in range(i + 1):
            weight = BINOMIALS[i, k] / BINOMIALS[n, k]
            for r in range(rows):
                controls[r, i] += weight * coefficients[r, n - k]
    return controls


@leaf
def set_basis(basis: FloatArray, index: int, w: float) -> None:
    """Write the Bernstein polynomials at w into row ``index``."""
    n = basis.shape[1] - 1
    power = 1.0
    for k in range(n + 1):
        basis[index, k] = BINOMIALS[n, k] * power
        power *= w
    power = 1.0
    for k in range(n, -1, -1):
        basis[index, k] *= power
        power *= 1.0 - w


@kernel
def power_from_bernstein(controls: FloatArray) -> FloatArray:
    """Return the power coefficients (m, n+1), highest first, of polynomials in the Bernstein basis.

    aₖ = C(n,k) Σᵢ (−1)ᵏ⁻ⁱ C(k,i) bᵢ.
    """
    rows, n = controls.shape[0], controls.shape[1] - 1
    coefficients = np.zeros((rows, n + 1))
    for k in range(n + 1):
        for i in range(k + 1):
            weight = BINOMIALS[n, k] * BINOMIALS[k, i] * (1.0 if (k - i) % 2 == 0 else -1.0)
            for r in range(rows):
                coefficients[r, n - k] += weight * controls[r, i]
    return coefficients


@leaf
def magnitude(coefficients: FloatArray) -> float:
    """Return the largest Σₖ |aₖ| over the rows: no Bernstein coefficient of any row is larger."""
    largest = 0.0
    for r in range(coefficients.shape[0]):
        total = 0.0
        for k in range(coefficients.shape[1]):
            total += abs(coefficients[r, k])
        largest = max(largest, total)
    return largest


@kernel
def scale(controls: FloatArray) -> FloatArray:
    """Return the scaled coefficients C(n,k) bₖ of every row: in them a product is a convolution."""
    n = controls.shape[1] - 1
    scaled = np.empty_like(controls)
    for r in range(controls.shape[0]):
        for k in range(n + 1):
            scaled[r, k] = BINOMIALS[n, k] * controls[r, k]
    return scaled


@leaf
def add_product(a: FloatArray, b: FloatArray, out: FloatArray) -> None:
    """Add a · b to ``out``, all in scaled coefficients: (m+1,), (n+1,), (m+n+1,)."""
    for i in range(a.shape[0]):
        for j in range(b.shape[0]):
            out[i + j] += a[i] * b[j]


@leaf
def halve(controls: FloatArray, left: FloatArray, right: FloatArray) -> None:
    """Write the Bernstein coefficients of every row on [0, ½] and [½, 1] (de Casteljau); (m, n+1) each.

    n averages in a chain: the count grows by n, the magnitude does not. ``controls`` may be ``right``.
    """
    n = controls.shape[1] - 1
    for r in range(controls.shape[0]):
        for k in range(n + 1):
            right[r, k] = controls[r, k]
        left[r, 0] = right[r, 0]
        for level in range(n):
            for k in range(n - level):
                right[r, k] = 0.5 * (right[r, k] + right[r, k + 1])
            left[r, level + 1] = right[r, 0]
