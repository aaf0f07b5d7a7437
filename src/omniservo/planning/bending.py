"""Bending energy ∫‖t″‖² dw + ℓ² ∫‖φ″‖² dw, the effort of a path (method section 6)."""

import numpy as np

from omniservo.geometry.arrays import FloatArray
from omniservo.geometry.kernel import kernel
from omniservo.geometry.polynomial import BINOMIALS


@kernel
def bending_form(n: int) -> FloatArray:
    """Return D (n−1, n−1), D_ij = ∫ B_i″ B_j″ dw for the inner Bernstein polynomials i, j = 1 … n−1.

    Σ_ij D_ij x_i·x_j is the energy of Σ x_i B_i; straight lines added to it change nothing.
    """
    second = np.zeros((max(n - 1, 0), max(n - 1, 0)))
    for i in range(1, n):
        for a, factor in ((i - 2, 1.0), (i - 1, -2.0), (i, 1.0)):
            if 0 <= a <= n - 2:
                second[i - 1, a] = factor * n * (n - 1)
    m = n - 2
    form = np.zeros_like(second)
    for i in range(n - 1):
        for j in range(n - 1):
            for a in range(n - 1):
                for b in range(n - 1):
                    gram = BINOMIALS[m, a] * BINOMIALS[m, b] / BINOMIALS[2 * m, a + b] / (2 * m + 1)
                    form[i, j] += second[i, a] * gram * second[j, b]
    return form


@kernel
def bending_energy(controls: FloatArray, form: FloatArray) -> float:
    """Return ∫‖p″‖² dw of control points (m, n+1); ``form`` from `bending_form`."""
    rows, n = controls.shape[0], controls.shape[1] - 1
    energy = 0.0
    for r in range(rows):
        for i in range(1, n):
            x = controls[r, i] - ((n - i) * controls[r, 0] + i * controls[r, n]) / n
            for j in range(1, n):
                y = controls[r, j] - ((n - j) * controls[r, 0] + j * controls[r, n]) / n
                energy += form[i - 1, j - 1] * x * y
    return energy
