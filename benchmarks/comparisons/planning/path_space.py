"""The polynomial paths of one degree, and what they keep at samples, with exact derivatives.

Unknowns x: offsets of the inner Bernstein control points of φ and of t/ℓ from the linearly interpolated
quaternion and the straight line, φ's σ−1 blocks of 4 first, then t's τ−1 blocks of 3. The space is that of
U, V in (25); x = 0 is the straight line.
"""

from __future__ import annotations

import math
from collections.abc import Iterator

import numpy as np
from benchmarks.comparisons.planning.neutral import Neutral
from scipy.special import comb

from omniservo.geometry.arrays import FloatArray
from omniservo.planning import CameraPath


def bernstein_basis(n: int, w: FloatArray) -> FloatArray:
    """Return B_k(w) (s, n+1) at w (s,)."""
    k = np.arange(n + 1)
    basis: FloatArray = comb(n, k) * w[:, None] ** k * (1.0 - w[:, None]) ** (n - k)
    return basis


def bending_matrix(n: int) -> FloatArray:
    """Return D (n−1, n−1), D_ij = ∫ B_i″ B_j″ dw of the inner Bernstein polynomials."""
    nodes, weights = np.polynomial.legendre.leggauss(n + 1)
    second = n * (n - 1) * _second_differences(n) @ bernstein_basis(n - 2, 0.5 * (nodes + 1.0)).T
    matrix: FloatArray = (second * (0.5 * weights)) @ second.T
    return matrix


def _second_differences(n: int) -> FloatArray:
    """Return what each inner B_i of degree n adds to the n−1 coefficients of the second derivative."""
    rows = np.zeros((n - 1, n - 1))
    for i in range(1, n):
        for a, factor in ((i - 2, 1.0), (i - 1, -2.0), (i, 1.0)):
            if 0 <= a <= n - 2:
                rows[i - 1, a] = factor
    return rows


class PathSpace:
    """All paths of degrees σ, τ between the end poses of a problem."""

    def __init__(self, neutral: Neutral, sigma: int, tau: int) -> None:
        self.neutral, self.sigma, self.tau = neutral, sigma, tau
        self.turns = 4 * (sigma - 1)
        """unknowns of φ; those of t follow"""
        self.size = self.turns + 3 * (tau - 1)
        self.bending = np.zeros((self.size, self.size))
        """H: the bending energy ∫‖t″‖²/ℓ² + ‖φ″‖² dw is xᵀHx"""
        if sigma > 1:
            self.bending[: self.turns, : self.turns] = np.kron(bending_matrix(sigma), np.eye(4))
        if tau > 1:
            self.bending[self.turns :, self.turns :] = np.kron(bending_matrix(tau), np.eye(3))

    def controls(self, x: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return the control points of φ (4, σ+1) and t (3, τ+1) [m]."""
        identity = np.array([0.0, 0.0, 0.0, 1.0])
        part = np.arange(self.sigma + 1) / self.sigma
        phi = np.outer(identity, 1.0 - part) + np.outer(self.neutral.quaternion, part)
        t = np.outer(self.neutral.translation, np.arange(self.tau + 1) / self.tau)
        phi[:, 1:-1] += x[: self.turns].reshape(-1, 4).T
        t[:, 1:-1] += self.neutral.ell * x[self.turns :].reshape(-1, 3).T
        return phi, t

    def path(self, x: FloatArray) -> CameraPath:
        """Return the path in the power basis; its ends are the end poses within rounding."""
        phi, t = self.controls(x)
        return CameraPath(_powers(phi), _powers(t))

    def energy(self, x: FloatArray) -> float:
        """Return the bending energy xᵀHx."""
        return float(x @ self.bending @ x)

    def starts(self, count: int) -> Iterator[FloatArray]:
        """Give the straight line, then sideways detours of growing size all round, every second one tilted.

        A detour moves every inner control point of t by one vector across t(1).
        """
        yield np.zeros(self.size)
        t = self.neutral.translation / max(float(np.linalg.norm(self.neutral.translation)), 1e-12)
        for i in range(1, count):
            angle, height = 2.399963229728653 * i, 1.0 - 2.0 * ((0.5698402909980532 * i) % 1.0)
            ring = math.sqrt(1.0 - height * height)
            way = np.array([ring * math.cos(angle), ring * math.sin(angle), height])
            across = way - (way @ t) * t
            across *= 0.3 * math.sqrt(i) / max(float(np.linalg.norm(across)), 1e-6)
            x = np.zeros(self.size)
            x[self.turns :] = np.tile(across, self.tau - 1)
            if i % 2 == 0:
                x[: self.turns] = np.tile([*(0.3 * way), 0.0], self.sigma - 1)
            yield x


def _powers(controls: FloatArray) -> FloatArray:
    """Return the power coefficients (m, n+1), highest first."""
    n = controls.shape[1] - 1
    columns = []
    for k in range(n, -1, -1):
        signs = [(-1) ** (k - i) * math.comb(n, k) * math.comb(k, i) for i in range(k + 1)]
        columns.append(controls[:, : k + 1] @ np.array(signs, dtype=np.float64))
    return np.column_stack(columns)
