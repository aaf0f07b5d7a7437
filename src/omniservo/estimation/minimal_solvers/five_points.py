"""The essential matrices of five matches: at most ten.

Nistér, "An efficient solution to the five-point relative pose problem", 2004. The matches leave a space of
four matrices, E = xX + yY + zZ + W; det E = 0 and 2EEᵀE − tr(EEᵀ)E = 0 are ten cubics in (x, y, z).
Elimination leaves a polynomial of degree ten in z. Bearings have no image plane, so nothing changes past 90°.
"""

import math

import numpy as np

from omniservo.geometry.arrays import FloatArray, IntArray
from omniservo.geometry.kernel import kernel, leaf
from omniservo.geometry.real_roots import real_roots

SAMPLE = 5
MOST_SOLUTIONS = 10

LARGEST_RATIO = 1e4
"""Solutions with |z| above it would need E ≈ Z, one direction out of all in the space."""

DETERMINANT = 9
"""det E = 0 is the last of the ten cubics, behind the nine of the trace."""

PAIRS = np.array([[0, 1, 2, 3], [1, 4, 5, 6], [2, 5, 7, 8], [3, 6, 8, 9]])
"""Place of the product of two of (x, y, z, 1) among xx, xy, xz, x, yy, yz, y, zz, z, 1."""

TRIPLES = np.array(
    [
        [0, 2, 4, 5], [2, 3, 8, 9], [4, 8, 10, 11], [5, 9, 11, 12], [3, 1, 6, 7],
        [8, 6, 13, 14], [9, 7, 14, 15], [10, 13, 16, 17], [11, 14, 17, 18], [12, 15, 18, 19],
    ]
)  # fmt: skip
"""Place of such a product times one of (x, y, z, 1) among the cubic monomials in the order of elimination:
xxx, yyy, xxy, xyy, xxz, xx, yyz, yy, xyz, xy, xzz, xz, x, yzz, yz, y, zzz, zz, z, 1."""


@kernel
def five_point_essentials(bearings: FloatArray, chosen: IntArray, essentials: FloatArray) -> int:
    """Write the essential matrices (10, 3, 3) of the five chosen matches; return how many there are.

    ``bearings`` (n, 6) holds (b, b*). Each has norm √2 like [t]× R with a unit t.
    """
    space, cubics, roots = np.empty((4, 9)), np.empty((10, 20)), np.empty(10)
    if not _null_space(bearings, chosen, space):
        return 0
    _write_cubics(space, cubics)
    if not _eliminate(cubics):
        return 0
    b = np.zeros((3, 3, 5))
    for row in range(3):
        _subtract_shifted(cubics[4 + 2 * row], cubics[5 + 2 * row], b[row])
    tenth = np.zeros(11)
    _write_determinant(b, tenth)
    count = 0
    for i in range(real_roots(tenth, LARGEST_RATIO, roots)):
        if _write_essential(b, roots[i], space, essentials[count]):
            count += 1
    return count


@kernel
def _null_space(bearings: FloatArray, chosen: IntArray, space: FloatArray) -> bool:
    """Write four orthonormal matrices (4, 9) with bᵀEb* = 0 for the chosen matches."""
    rows = np.empty((9, 9))
    for i in range(SAMPLE):
        for p in range(3):
            for q in range(3):
                rows[i, 3 * p + q] = bearings[chosen[i], p] * bearings[chosen[i], 3 + q]
    for i in range(9):
        if i >= SAMPLE:
            # The unit vector that the rows so far hold least of
            least, place = math.inf, 0
            for k in range(9):
                part = 0.0
                for j in range(i):
                    part += rows[j, k] * rows[j, k]
                if part < least:
                    least, place = part, k
            rows[i, :] = 0.0
            rows[i, place] = 1.0
        for _ in range(2):
            for j in range(i):
                along = 0.0
                for k in range(9):
                    along += rows[j, k] * rows[i, k]
                for k in range(9):
                    rows[i, k] -= along * rows[j, k]
        square = 0.0
        for k in range(9):
            square += rows[i, k] * rows[i, k]
        if square < 1e-20:
            return False
        square = 1.0 / math.sqrt(square)
        for k in range(9):
            rows[i, k] *= square
    for i in range(4):
        for k in range(9):
            space[i, k] = rows[SAMPLE + i, k]
    return True


@leaf
def _add_quadratic(factor: float, space: FloatArray, i: int, k: int, quadratic: FloatArray) -> None:
    """Add factor · E_i E_k, entries of E as linear forms in (x, y, z, 1), to a quadratic (10,)."""
    for p in range(4):
        for q in range(4):
            quadratic[PAIRS[p, q]] += factor * space[p, i] * space[q, k]


@leaf
def _add_cubic(quadratic: FloatArray, space: FloatArray, i: int, cubic: FloatArray) -> None:
    """Add quadratic · E_i to a cubic (20,)."""
    for p in range(10):
        for q in range(4):
            cubic[TRIPLES[p, q]] += quadratic[p] * space[q, i]


@kernel
def _write_cubics(space: FloatArray, cubics: FloatArray) -> None:
    """Write (10, 20): (EEᵀ − ½ tr(EEᵀ)) E = 0, nine rows, and det E = 0."""
    cubics[:, :] = 0.0
    square, half = np.zeros((6, 10)), np.zeros(10)
    place = np.array([[0, 1, 2], [1, 3, 4], [2, 4, 5]])
    for i in range(3):
        for k in range(i, 3):
            for c in range(3):
                _add_quadratic(1.0, space, 3 * i + c, 3 * k + c, square[place[i, k]])
    for p in range(10):
        half[p] = 0.5 * (square[0, p] + square[3, p] + square[5, p])
    for p in range(10):
        square[0, p] -= half[p]
        square[3, p] -= half[p]
        square[5, p] -= half[p]
    for i in range(3):
        for c in range(3):
            for k in range(3):
                _add_cubic(square[place[i, k]], space, 3 * k + c, cubics[3 * i + c])
    for c in range(3):
        minor = np.zeros(10)
        d, e = (c + 1) % 3, (c + 2) % 3
        _add_quadratic(1.0, space, 3 + d, 6 + e, minor)
        _add_quadratic(-1.0, space, 3 + e, 6 + d, minor)
        _add_cubic(minor, space, c, cubics[DETERMINANT])


@leaf
def _eliminate(a: FloatArray) -> bool:
    """Reduce the first ten columns of (10, 20) to the identity, as far as the last six rows need."""
    for step in range(10):
        row = step
        for i in range(step + 1, 10):
            if abs(a[i, step]) > abs(a[row, step]):
                row = i
        if abs(a[row, step]) < 1e-14:
            return False
        if row != step:
            for k in range(step, 20):
                a[step, k], a[row, k] = a[row, k], a[step, k]
        scale = 1.0 / a[step, step]
        for k in range(step, 20):
            a[step, k] *= scale
        for i in range(4 if step >= 4 else step + 1, 10):
            if i != step and a[i, step] != 0.0:
                factor = a[i, step]
                for k in range(step, 20):
                    a[i, k] -= factor * a[step, k]
    return True


@leaf
def _subtract_shifted(e: FloatArray, f: FloatArray, row: FloatArray) -> None:
    """Write e − z f as polynomials in z, lowest power first, of x, y and 1: (3, 5).

    e has the leading monomial of f times z, so that it drops out.
    """
    for c in range(2):
        for power in range(3):
            row[c, power] += e[12 + 3 * c - power]
            row[c, power + 1] -= f[12 + 3 * c - power]
    for power in range(4):
        row[2, power] += e[19 - power]
        row[2, power + 1] -= f[19 - power]


@kernel
def _write_determinant(b: FloatArray, tenth: FloatArray) -> None:
    """Add det B(z) to ``tenth`` (11,), lowest power first."""
    minor = np.empty(8)
    for i in range(3):
        j, k = (i + 1) % 3, (i + 2) % 3
        minor[:] = 0.0
        for p in range(4):
            for q in range(4):
                minor[p + q] += b[j, 0, p] * b[k, 1, q] - b[k, 0, p] * b[j, 1, q]
        for p in range(7):
            for q in range(5):
                if p + q < 11:
                    tenth[p + q] += minor[p] * b[i, 2, q]


@kernel
def _write_essential(b: FloatArray, z: float, space: FloatArray, essential: FloatArray) -> bool:
    """Write E for a root z: (x, y, 1) spans the null space of B(z)."""
    at = np.empty((3, 3))
    for i in range(3):
        for c in range(3):
            at[i, c] = b[i, c, 4]
            for power in range(3, -1, -1):
                at[i, c] = at[i, c] * z + b[i, c, power]
    best, x, y, w = 0.0, 0.0, 0.0, 0.0
    for i in range(3):
        j = (i + 1) % 3
        u = at[i, 1] * at[j, 2] - at[i, 2] * at[j, 1]
        v = at[i, 2] * at[j, 0] - at[i, 0] * at[j, 2]
        s = at[i, 0] * at[j, 1] - at[i, 1] * at[j, 0]
        if u * u + v * v + s * s > best:
            best, x, y, w = u * u + v * v + s * s, u, v, s
    if not (best > 0.0 and abs(w) > 1e-9 * math.sqrt(best)):
        return False
    x, y = x / w, y / w
    scale = math.sqrt(2.0 / (x * x + y * y + z * z + 1.0))
    for i in range(9):
        entry = x * space[0, i] + y * space[1, i] + z * space[2, i] + space[3, i]
        essential[i // 3, i % 3] = scale * entry
    return True
