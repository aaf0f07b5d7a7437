"""A path and what it shows, as Bernstein coefficients with error counts (docs/certificate.md)."""

import numpy as np

from omniservo.geometry.arrays import FloatArray
from omniservo.geometry.kernel import kernel, leaf
from omniservo.geometry.polynomial import (
    BINOMIALS,
    UNIT,
    add_product,
    bernstein_from_power,
    magnitude,
    scale,
)

ROTATION_FLOOR = 0.01
"""‖φ‖² stays above it: R(w) is well defined."""


@kernel
def camera_controls(
    rotation: FloatArray, translation: FloatArray, points: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Return c(w) = Λ(φ)ᵀ(h − t) of every point as control points, and their error per count.

    Args:
        rotation: power coefficients of φ (4, σ+1), highest first.
        translation: power coefficients of t (3, τ+1), highest first [m].
        points: h (n, 3) [m].

    Returns:
        controls (n, 3, 2σ+τ+1) [m], magnitudes times UNIT (n,). The count is ``camera_count(σ, τ)``.
    """
    sigma, tau = rotation.shape[1] - 1, translation.shape[1] - 1
    degree, n = 2 * sigma + tau, points.shape[0]
    matrix = _rotation_controls(scale(bernstein_from_power(rotation)))
    centre = scale(bernstein_from_power(translation))
    sums = np.empty((4, degree + 1))
    controls = np.empty((n, 3, degree + 1))
    for j in range(3):
        _add_raised(matrix, j, centre, sums)
        for k in range(degree + 1):
            binomial = BINOMIALS[degree, k]
            for i in range(4):
                sums[i, k] /= binomial
        for p in range(n):
            x, y, z = points[p, 0], points[p, 1], points[p, 2]
            for k in range(degree + 1):
                controls[p, j, k] = sums[0, k] * x + sums[1, k] * y + sums[2, k] * z - sums[3, k]
    errors = np.empty(n)
    size = 12.0 * UNIT * magnitude(rotation) ** 2
    reach = magnitude(translation)
    for p in range(n):
        errors[p] = size * (reach + max(abs(points[p, 0]), abs(points[p, 1]), abs(points[p, 2])))
    return controls, errors


@leaf
def camera_count(sigma: int, tau: int) -> int:
    """Return the count of `camera_controls`."""
    return 3 * sigma + 4 * tau + 22


@kernel
def _rotation_controls(phi: FloatArray) -> FloatArray:
    """Return Λ(φ) (20) as scaled coefficients (3, 3, 2σ+1) from those of φ (4, σ+1)."""
    n = phi.shape[1]
    products = np.zeros((4, 4, 2 * n - 1))
    for a in range(4):
        for b in range(a, 4):
            for i in range(n):
                for k in range(n):
                    products[a, b, i + k] += phi[a, i] * phi[b, k]
    out = np.empty((3, 3, 2 * n - 1))
    for k in range(2 * n - 1):
        xx, xy, xz, xw = products[0, 0, k], products[0, 1, k], products[0, 2, k], products[0, 3, k]
        yy, yz, yw = products[1, 1, k], products[1, 2, k], products[1, 3, k]
        zz, zw, ww = products[2, 2, k], products[2, 3, k], products[3, 3, k]
        out[0, 0, k], out[0, 1, k], out[0, 2, k] = xx - yy - zz + ww, 2.0 * (xy - zw), 2.0 * (xz + yw)
        out[1, 0, k], out[1, 1, k], out[1, 2, k] = 2.0 * (xy + zw), yy - xx - zz + ww, 2.0 * (yz - xw)
        out[2, 0, k], out[2, 1, k], out[2, 2, k] = 2.0 * (xz - yw), 2.0 * (yz + xw), zz - xx - yy + ww
    return out


@leaf
def _add_raised(matrix: FloatArray, j: int, centre: FloatArray, sums: FloatArray) -> None:
    """Write column j of Λ, raised to degree 2σ+τ, and its product with t into ``sums`` (4, 2σ+τ+1)."""
    m, n = matrix.shape[2], centre.shape[1]
    for k in range(m + n - 1):
        sums[0, k] = sums[1, k] = sums[2, k] = sums[3, k] = 0.0
    for i in range(3):
        for a in range(m):
            value = matrix[i, j, a]
            for b in range(n):
                sums[i, a + b] += value * BINOMIALS[n - 1, b]
                sums[3, a + b] += value * centre[i, b]


@kernel
def squares(coefficients: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return ‖p‖² (1, 2n+1) and p raised to the same degree (m, 2n+1) of p given by powers (m, n+1).

    Counts 6n + 12 with magnitude m·M² (m ≤ 4), and 2n + 5 with magnitude M = ``magnitude(coefficients)``.
    """
    rows, n = coefficients.shape[0], coefficients.shape[1] - 1
    scaled = scale(bernstein_from_power(coefficients))
    square = np.zeros((1, 2 * n + 1))
    raised = np.zeros((rows, 2 * n + 1))
    for r in range(rows):
        add_product(scaled[r], scaled[r], square[0])
        add_product(scaled[r], BINOMIALS[n, : n + 1], raised[r])
    for k in range(2 * n + 1):
        square[0, k] /= BINOMIALS[2 * n, k]
        for r in range(rows):
            raised[r, k] /= BINOMIALS[2 * n, k]
    return square, raised
