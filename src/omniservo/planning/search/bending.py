"""Bending energy ∫‖t″‖² dw + ℓ² ∫‖φ″‖² dw, the effort of a path (method section 6)."""

import numpy as np

from omniservo.geometry.arrays import FloatArray
from omniservo.geometry.kernel import kernel, leaf
from omniservo.geometry.polynomial import BINOMIALS


@kernel
def bending_form(n: int, first: int) -> FloatArray:
    """Return D (n−first, n−first), D_ij = ∫ B_i″ B_j″ dw for the Bernstein polynomials i, j = first … n−1.

    Σ_ij D_ij x_i·x_j is the energy of Σ x_i B_i.
    """
    size = max(n - first, 0)
    second = np.zeros((size, max(n - 1, 0)))
    for i in range(first, n):
        for a, factor in ((i - 2, 1.0), (i - 1, -2.0), (i, 1.0)):
            if 0 <= a <= n - 2:
                second[i - first, a] = factor * n * (n - 1)
    m = n - 2
    form = np.zeros((size, size))
    for i in range(size):
        for j in range(size):
            for a in range(n - 1):
                for b in range(n - 1):
                    gram = BINOMIALS[m, a] * BINOMIALS[m, b] / BINOMIALS[2 * m, a + b] / (2 * m + 1)
                    form[i, j] += second[i, a] * gram * second[j, b]
    return form


@leaf
def least_bent(end: FloatArray, slope: FloatArray, controls: FloatArray) -> float:
    """Bend control points (m, n+1), whose first column is the start, least; return ∫‖p″‖² dw.

    p(0) and p(1) = ``end`` (m,) are given, p′(0) = ``slope`` (m,) too where n ≥ 2; a straight line needs
    slope = end − start. From n = 3 on that is the cubic with p″ = (1 − w) a, a = 3 (p(1) − p(0) − p′(0)); as
    it is the least, other paths of the same ends and slope have its energy and that of their offset from it.
    """
    n, energy = controls.shape[1] - 1, 0.0
    for r in range(controls.shape[0]):
        start = controls[r, 0]
        missing = end[r] - start - slope[r]
        for i in range(1, n):
            part = i / n
            controls[r, i] = start + part * slope[r]
            if n > 2:
                half = part * (i - 1.0) / (n - 1.0)
                controls[r, i] += missing * half * (1.5 - 0.5 * (i - 2.0) / (n - 2.0))
        controls[r, n] = end[r]
        if n > 1:
            energy += missing * missing * (3.0 if n > 2 else 4.0)
    return energy
