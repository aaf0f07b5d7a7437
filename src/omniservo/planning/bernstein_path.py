"""A path and what it shows, as Bernstein coefficients with error counts (docs/certificate.md)."""

import numpy as np

from omniservo.geometry.arrays import FloatArray, IntArray
from omniservo.geometry.kernel import kernel
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

_TERMS: IntArray = np.array(
    [(i, i, k, k, 1 if k in (i, 3) else -1) for i in range(3) for k in range(4)]
    + [(i, j, i, j, 2) for i in range(3) for j in range(3) if i != j]
    + [
        (0, 1, 2, 3, -2),
        (1, 0, 2, 3, 2),
        (0, 2, 1, 3, 2),
        (2, 0, 1, 3, -2),
        (1, 2, 0, 3, -2),
        (2, 1, 0, 3, 2),
    ]
)
"""Λ(φ) (20): at [i, j] stands the sum of factor · φ_a · φ_b over the rows (i, j, a, b, factor)."""


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
    degree = 2 * sigma + tau
    matrix = _rotation_controls(scale(bernstein_from_power(rotation)))
    centre = scale(bernstein_from_power(translation))
    raised = np.zeros((3, 3, degree + 1))
    moved = np.zeros((3, degree + 1))
    for j in range(3):
        for i in range(3):
            add_product(1.0, matrix[i, j], BINOMIALS[tau, : tau + 1], raised[i, j])
            add_product(1.0, matrix[i, j], centre[i], moved[j])
    n = points.shape[0]
    controls = np.empty((n, 3, degree + 1))
    for k in range(degree + 1):
        binomial = BINOMIALS[degree, k]
        for j in range(3):
            a, b, c = raised[0, j, k] / binomial, raised[1, j, k] / binomial, raised[2, j, k] / binomial
            d = moved[j, k] / binomial
            for p in range(n):
                controls[p, j, k] = a * points[p, 0] + b * points[p, 1] + c * points[p, 2] - d
    errors = np.empty(n)
    size = 12.0 * UNIT * magnitude(rotation) ** 2
    reach = magnitude(translation)
    for p in range(n):
        errors[p] = size * (reach + max(abs(points[p, 0]), abs(points[p, 1]), abs(points[p, 2])))
    return controls, errors


@kernel
def camera_count(sigma: int, tau: int) -> int:
    """Return the count of `camera_controls`."""
    return 6 * sigma + 4 * tau + 22


@kernel
def _rotation_controls(phi: FloatArray) -> FloatArray:
    """Return Λ(φ) (20) as scaled coefficients (3, 3, 2σ+1) from those of φ (4, σ+1)."""
    out = np.zeros((3, 3, 2 * phi.shape[1] - 1))
    for term in range(_TERMS.shape[0]):
        i, j, a, b = _TERMS[term, 0], _TERMS[term, 1], _TERMS[term, 2], _TERMS[term, 3]
        add_product(float(_TERMS[term, 4]), phi[a], phi[b], out[i, j])
    return out


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
        add_product(1.0, scaled[r], scaled[r], square[0])
        add_product(1.0, scaled[r], BINOMIALS[n, : n + 1], raised[r])
    for k in range(2 * n + 1):
        square[0, k] /= BINOMIALS[2 * n, k]
        for r in range(rows):
            raised[r, k] /= BINOMIALS[2 * n, k]
    return square, raised
