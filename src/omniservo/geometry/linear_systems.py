"""Small dense symmetric systems for the kernels of this room: no LAPACK call, no allocation inside loops."""

import math

import numpy as np

from omniservo.geometry.arrays import FloatArray
from omniservo.geometry.kernel import kernel, leaf

INVERSE_ITERATIONS = 6

_QL_STEPS = 60
"""for one eigenvalue at most; two are the rule"""


@leaf
def factor_cholesky(matrix: FloatArray, size: int, least: float) -> bool:
    """Replace the lower triangle of ``matrix[:size, :size]`` by its Cholesky factor L, matrix = L Lᵀ.

    Returns False, with the matrix spoilt, where a pivot falls below ``least`` times its diagonal entry
    (the matrix is singular or indefinite to that relative precision) or is not a number.
    """
    for j in range(size):
        pivot = matrix[j, j]
        bound = least * abs(pivot)
        for k in range(j):
            pivot -= matrix[j, k] * matrix[j, k]
        if not (pivot > bound and pivot < math.inf):
            return False
        root = math.sqrt(pivot)
        matrix[j, j] = root
        for i in range(j + 1, size):
            entry = matrix[i, j]
            for k in range(j):
                entry -= matrix[i, k] * matrix[j, k]
            matrix[i, j] = entry / root
    return True


@leaf
def solve_factored(factor: FloatArray, size: int, vector: FloatArray) -> None:
    """Replace ``vector[:size]`` by the solution x of L Lᵀ x = vector, L from :func:`factor_cholesky`."""
    for i in range(size):
        entry = vector[i]
        for k in range(i):
            entry -= factor[i, k] * vector[k]
        vector[i] = entry / factor[i, i]
    for i in range(size - 1, -1, -1):
        entry = vector[i]
        for k in range(i + 1, size):
            entry -= factor[k, i] * vector[k]
        vector[i] = entry / factor[i, i]


@kernel
def invert_factored(factor: FloatArray, inverse: FloatArray) -> None:
    """Write the inverse (n, n) of L Lᵀ, L from :func:`factor_cholesky`."""
    column = np.empty(len(inverse))
    for k in range(len(inverse)):
        column[:] = 0.0
        column[k] = 1.0
        solve_factored(factor, len(inverse), column)
        inverse[:, k] = column


@kernel
def symmetric_eigen(matrix: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return the eigenvalues (m,), ascending, and eigenvectors (m, m), one a column, of a symmetric matrix.

    Householder's reduction to three diagonals, then implicit QL steps with Wilkinson's shift (Bowdler et al.
    1968): small eigenvalues keep their absolute accuracy of a rounding of the norm.
    """
    m = matrix.shape[0]
    a, rows = matrix.copy(), np.eye(m)
    diagonal, beside = np.empty(m), np.zeros(m)
    _reduce(a, rows, diagonal, beside)
    _diagonalise(rows, diagonal, beside)
    values, vectors = np.empty(m), np.empty((m, m))
    for place in range(m):
        least = -1
        for i in range(m):
            if not math.isnan(diagonal[i]) and (least < 0 or diagonal[i] < diagonal[least]):
                least = i
        values[place] = diagonal[least]
        for k in range(m):
            vectors[k, place] = rows[least, k]
        diagonal[least] = math.nan
    return values, vectors


@leaf
def _reduce(a: FloatArray, rows: FloatArray, diagonal: FloatArray, beside: FloatArray) -> None:
    """Reflect the symmetric ``a`` to three diagonals, and the columns of what ``rows`` has as rows with it.

    Of the reflection I − β v vᵀ, v stands in a column of ``a`` and βAv − κv in the row of the same number.
    """
    m = a.shape[0]
    for k in range(m - 2):
        square = 0.0
        for i in range(k + 2, m):
            square += a[i, k] * a[i, k]
        if square == 0.0:
            beside[k] = a[k + 1, k]
            continue
        length = math.sqrt(a[k + 1, k] * a[k + 1, k] + square)
        beside[k] = -length if a[k + 1, k] >= 0.0 else length
        a[k + 1, k] -= beside[k]
        beta = 2.0 / (a[k + 1, k] * a[k + 1, k] + square)
        along = 0.0
        for i in range(k + 1, m):
            total = 0.0
            for j in range(k + 1, m):
                total += a[i, j] * a[j, k]
            a[k, i] = beta * total
            along += a[k, i] * a[i, k]
        along *= 0.5 * beta
        for i in range(k + 1, m):
            a[k, i] -= along * a[i, k]
        for i in range(k + 1, m):
            for j in range(k + 1, m):
                a[i, j] -= a[i, k] * a[k, j] + a[k, i] * a[j, k]
        for c in range(m):
            total = 0.0
            for i in range(k + 1, m):
                total += rows[i, c] * a[i, k]
            for i in range(k + 1, m):
                rows[i, c] -= beta * total * a[i, k]
    for i in range(m):
        diagonal[i] = a[i, i]
    if m > 1:
        beside[m - 2] = a[m - 1, m - 2]


@leaf
def _diagonalise(rows: FloatArray, d: FloatArray, e: FloatArray) -> None:
    """Make the matrix with diagonal d (m,) and e (m,), its last 0, beside it diagonal: d; turn the rows."""
    m = d.shape[0]
    for first in range(m):
        for _ in range(_QL_STEPS):
            last = first
            while last < m - 1 and abs(e[last]) > 1.1e-16 * (abs(d[last]) + abs(d[last + 1])):
                last += 1
            if last == first:
                break
            ratio = (d[first + 1] - d[first]) / (2.0 * e[first])
            root = math.sqrt(ratio * ratio + 1.0)
            g = d[last] - d[first] + e[first] / (ratio + (root if ratio >= 0.0 else -root))
            s, c, p, whole = 1.0, 1.0, 0.0, True
            for i in range(last - 1, first - 1, -1):
                f, b = s * e[i], c * e[i]
                r = math.sqrt(f * f + g * g)
                e[i + 1] = r
                if r == 0.0:
                    d[i + 1] -= p
                    e[last] = 0.0
                    whole = False
                    break
                s, c = f / r, g / r
                g = d[i + 1] - p
                r = (d[i] - g) * s + 2.0 * c * b
                p = s * r
                d[i + 1] = g + p
                g = c * r - b
                for k in range(m):
                    x, y = rows[i, k], rows[i + 1, k]
                    rows[i, k], rows[i + 1, k] = c * x - s * y, s * x + c * y
            if whole:
                d[first] -= p
                e[first] = g
                e[last] = 0.0


@kernel
def smallest_eigenvectors(matrix: FloatArray, vectors: FloatArray, values: FloatArray) -> None:
    """Write eigenvectors (m, k), one a column, and values (k,), ascending, of a semidefinite matrix (m, m).

    Inverse iteration of a subspace on the matrix, shifted by a rounding of its trace so that a singular one
    will do, and Rayleigh-Ritz in it. Exact where the k smallest eigenvalues lie well below the next; where
    they do not, such vectors are as good as any of that part of the spectrum.
    """
    m, k = vectors.shape
    factor, column = np.empty((m, m)), np.empty(m)
    shift = 0.0
    for i in range(m):
        shift += matrix[i, i]
    shift = 1e-15 * shift + 1e-300
    for i in range(m):
        for j in range(i + 1):
            factor[i, j] = matrix[i, j]
        factor[i, i] += shift
        for j in range(k):
            vectors[i, j] = math.cos((i + 1.0) * (2 * j + 1.0))  # any full set without symmetry
    if not factor_cholesky(factor, m, 0.0):
        return
    for _ in range(INVERSE_ITERATIONS):
        for j in range(k):
            for i in range(m):
                column[i] = vectors[i, j]
            solve_factored(factor, m, column)
            for i in range(m):
                vectors[i, j] = column[i]
            _orthonormalise(vectors, j)
    _rayleigh_ritz(matrix, vectors, values)


@leaf
def _orthonormalise(vectors: FloatArray, j: int) -> None:
    """Make column ``j`` of length 1 and orthogonal to those before it, twice for the sake of rounding."""
    m = vectors.shape[0]
    for _ in range(2):
        for before in range(j):
            along = 0.0
            for i in range(m):
                along += vectors[i, before] * vectors[i, j]
            for i in range(m):
                vectors[i, j] -= along * vectors[i, before]
        square = 0.0
        for i in range(m):
            square += vectors[i, j] * vectors[i, j]
        scale = 1.0 / math.sqrt(square)
        for i in range(m):
            vectors[i, j] *= scale


@kernel
def _rayleigh_ritz(matrix: FloatArray, vectors: FloatArray, values: FloatArray) -> None:
    """Turn orthonormal columns, in their span, to the eigenvectors of the matrix restricted to it."""
    m, k = vectors.shape
    small, product, old = np.zeros((k, k)), np.empty(m), vectors.copy()
    for j in range(k):
        for i in range(m):
            product[i] = 0.0
            for h in range(m):
                product[i] += matrix[i, h] * old[h, j]
        for b in range(k):
            for i in range(m):
                small[b, j] += old[i, b] * product[i]
    for b in range(k):
        for j in range(b):
            small[b, j] = 0.5 * (small[b, j] + small[j, b])
            small[j, b] = small[b, j]
    found, turn = symmetric_eigen(small)
    for j in range(k):
        values[j] = found[j]
        for i in range(m):
            vectors[i, j] = 0.0
            for b in range(k):
                vectors[i, j] += old[i, b] * turn[b, j]
