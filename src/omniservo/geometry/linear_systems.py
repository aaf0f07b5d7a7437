"""Small dense symmetric systems for the kernels of this room: no LAPACK call, no allocation inside loops."""

import math

import numpy as np

from omniservo.geometry.arrays import FloatArray
from omniservo.geometry.kernel import kernel, leaf

INVERSE_ITERATIONS = 6


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
def symmetric_eigen(matrix: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return the eigenvalues (m,), ascending, and eigenvectors (m, m), one a column, of a symmetric matrix.

    Cyclic Jacobi rotations: small eigenvalues keep their absolute accuracy of a rounding of the norm.
    """
    m = matrix.shape[0]
    a = matrix.copy()
    v = np.eye(m)
    for _ in range(30):
        off = 0.0
        total = 0.0
        for i in range(m):
            total += a[i, i] * a[i, i]
            for j in range(i):
                off += a[i, j] * a[i, j]
        if not off > 1e-34 * total:
            break
        for i in range(m - 1):
            for j in range(i + 1, m):
                _rotate(a, v, i, j)
    values = np.empty(m)
    vectors = np.empty((m, m))
    for place in range(m):
        least = -1
        for i in range(m):
            if not math.isnan(a[i, i]) and (least < 0 or a[i, i] < a[least, least]):
                least = i
        values[place] = a[least, least]
        for k in range(m):
            vectors[k, place] = v[k, least]
        a[least, least] = math.nan
    return values, vectors


@leaf
def _rotate(a: FloatArray, v: FloatArray, i: int, j: int) -> None:
    """Zero the entry (i, j) of the symmetric ``a`` by one rotation and collect it in ``v``."""
    if a[i, j] == 0.0:
        return
    ratio = (a[j, j] - a[i, i]) / (2.0 * a[i, j])
    tangent = 1.0 / (abs(ratio) + math.sqrt(ratio * ratio + 1.0))
    if ratio < 0.0:
        tangent = -tangent
    c = 1.0 / math.sqrt(tangent * tangent + 1.0)
    s = tangent * c
    for k in range(a.shape[0]):
        p, q = a[k, i], a[k, j]
        a[k, i] = c * p - s * q
        a[k, j] = s * p + c * q
    for k in range(a.shape[0]):
        p, q = a[i, k], a[j, k]
        a[i, k] = c * p - s * q
        a[j, k] = s * p + c * q
        p, q = v[k, i], v[k, j]
        v[k, i] = c * p - s * q
        v[k, j] = s * p + c * q


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
