"""Motions and targets that two views cannot resolve: none, a pure rotation, a plane.

All three say b ∝ G b* for one matrix G: the identity, a rotation, a homography. G is fitted in px with its
first-order maximum-likelihood cost  Σ eᵀ(I + AAᵀ)⁻¹e,  e = p − π(G b*), A = ∂π(G b*)/∂p*, so its cost can be
compared with that of motion and structure.
"""

import math

import numpy as np

from omniservo.cameras.unified_kernels import project_point_jacobian
from omniservo.estimation.matches import Matches
from omniservo.estimation.minimal_solvers.essential_matrix import (
    GOAL_XU,
    GOAL_XV,
    GOAL_YU,
    GOAL_YV,
    GOAL_ZU,
    GOAL_ZV,
)
from omniservo.estimation.refinement.pose_refinement import cauchy_loss
from omniservo.geometry.arrays import BoolArray, FloatArray
from omniservo.geometry.kernel import kernel, leaf
from omniservo.geometry.linear_systems import (
    factor_cholesky,
    smallest_eigenvectors,
    solve_factored,
    symmetric_eigen,
)
from omniservo.geometry.matrix_products import times, transposed_times
from omniservo.geometry.quaternions import matrix_from_quaternion
from omniservo.geometry.rotation_row import XX, XY, XZ, YX, YY, YZ, ZX, ZY, ZZ

IDENTITY = 0
ROTATION = 1
HOMOGRAPHY = 2
MOST_STEPS = 8

FEW = 24
"""Where there are twice as many matches, so many of them are checked first."""

OUT_OF_REACH = 4.0
"""A refinement that the quadratic model sees end above so many times the interesting cost is left."""


@kernel
def refine_linear_map(
    matches: Matches, kind: int, loss_scale: float, most: float, most_steps: int, matrix: FloatArray
) -> float:
    """Refine G (3, 3) in place and return its cost [px²], infinite where it leaves the domain.

    ``loss_scale`` is the c [px] of the Cauchy loss on a match, infinite for least squares. Costs far above
    ``most`` are of no interest and need not be at their minimum. Gauss-Newton; a step that does not lower
    the cost ends it.
    """
    size = 3 if kind == ROTATION else 9
    normal, gradient = np.empty((9, 9)), np.empty(9)
    cost = _accumulate(matches, loss_scale, size, matrix, normal, gradient)
    if kind == IDENTITY:
        return cost
    trial, turn, step = np.empty((3, 3)), np.empty((3, 3)), np.empty(9)
    for _ in range(most_steps):
        if not cost < math.inf:
            break
        if kind == HOMOGRAPHY:
            _hold_scale(matrix, normal)
        if not factor_cholesky(normal, size, 1e-13):
            break
        decrement = 0.0
        for i in range(size):
            step[i] = gradient[i]
        solve_factored(normal, size, step)
        for i in range(size):
            decrement += step[i] * gradient[i]
        if cost - decrement > OUT_OF_REACH * most and decrement < 0.5 * cost:
            break
        _step(kind, matrix, step, turn, trial)
        lower = _accumulate(matches, loss_scale, size, trial, normal, gradient)
        if not lower < cost:
            break
        small = cost - lower < 1e-6 * cost
        cost = lower
        for i in range(9):
            matrix[i // 3, i % 3] = trial[i // 3, i % 3]
        if small:
            break
    return cost


@leaf
def _hold_scale(g: FloatArray, normal: FloatArray) -> None:
    """Add a penalty along G itself: the cost does not depend on its norm."""
    weight = 0.0
    for i in range(9):
        weight += normal[i, i]
    for i in range(9):
        for k in range(i + 1):
            normal[i, k] += weight * g[i // 3, i % 3] * g[k // 3, k % 3]


@leaf
def _step(kind: int, matrix: FloatArray, step: FloatArray, turn: FloatArray, trial: FloatArray) -> None:
    """Write into ``trial`` the map moved by the step: R exp([δ]×), or G + dG with norm 1."""
    if kind == HOMOGRAPHY:
        norm = 0.0
        for i in range(9):
            trial[i // 3, i % 3] = matrix[i // 3, i % 3] + step[i]
            norm += trial[i // 3, i % 3] ** 2
        norm = 1.0 / math.sqrt(norm)
        for i in range(9):
            trial[i // 3, i % 3] *= norm
        return
    # The quaternion (δ/2, 1) is exp([δ]×) to second order, enough for a step that is measured afterwards.
    matrix_from_quaternion(0.5 * step[0], 0.5 * step[1], 0.5 * step[2], 1.0, turn)
    for i in range(3):
        for k in range(3):
            trial[i, k] = matrix[i, 0] * turn[0, k] + matrix[i, 1] * turn[1, k] + matrix[i, 2] * turn[2, k]


@kernel
def _accumulate(
    matches: Matches,
    loss_scale: float,
    size: int,
    g: FloatArray,
    normal: FloatArray,
    gradient: FloatArray,
) -> float:
    """Fill the normal equations (lower triangle; δ for size 3, dG row by row for 9); return the cost."""
    normal[:, :] = 0.0
    gradient[:] = 0.0
    rows = np.empty((2, 9))
    cost = 0.0
    for j in range(matches.pixels.shape[0]):
        eu, ev, suu, suv, svv, ok = _linearise_match(matches, j, size, g, rows)
        if not ok:
            return math.inf
        f = 1.0 / (suu * svv - suv * suv)
        wu, wv = f * (svv * eu - suv * ev), f * (suu * ev - suv * eu)
        square = eu * wu + ev * wv
        if loss_scale == math.inf:
            cost += square
        else:
            cost += cauchy_loss(square, loss_scale)
            weight = 1.0 / (1.0 + square / (loss_scale * loss_scale))
            f, wu, wv = weight * f, weight * wu, weight * wv
        for i in range(size):
            gradient[i] += rows[0, i] * wu + rows[1, i] * wv
            x = f * (svv * rows[0, i] - suv * rows[1, i])
            y = f * (suu * rows[1, i] - suv * rows[0, i])
            for k in range(i + 1):
                normal[i, k] += x * rows[0, k] + y * rows[1, k]
    return cost


@leaf
def _linearise_match(
    matches: Matches, j: int, size: int, g: FloatArray, rows: FloatArray
) -> tuple[float, float, float, float, float, bool]:
    """Return match ``j``'s e (2) and I + AAᵀ (uu, uv, vv), weighted, and write de's rows (2, 9), negated."""
    bearings, k = matches.bearings, matches.jacobians[j]
    x, y, z = bearings[j, 3], bearings[j, 4], bearings[j, 5]
    gx, gy, gz = times(g, x, y, z)
    u, v, a0, a1, a2, b0, b1, b2, ok = project_point_jacobian(matches.parameters, gx, gy, gz)
    if not ok:
        return 0.0, 0.0, 1.0, 0.0, 1.0, False
    w = matches.weights[j, 0]
    a0, a1, a2, b0, b1, b2 = w * a0, w * a1, w * a2, w * b0, w * b1, w * b2
    l0, l1, l2 = transposed_times(g, a0, a1, a2)
    m0, m1, m2 = transposed_times(g, b0, b1, b2)
    if size == 3:  # dc = R (δ × b*) = −R [b*]× δ, and mᵀ(δ × b*) = δ·(b* × m)
        rows[0, 0], rows[0, 1], rows[0, 2] = y * l2 - z * l1, z * l0 - x * l2, x * l1 - y * l0
        rows[1, 0], rows[1, 1], rows[1, 2] = y * m2 - z * m1, z * m0 - x * m2, x * m1 - y * m0
    else:
        _write_outer(rows[0], a0, a1, a2, x, y, z)
        _write_outer(rows[1], b0, b1, b2, x, y, z)
    au = l0 * k[GOAL_XU] + l1 * k[GOAL_YU] + l2 * k[GOAL_ZU]
    av = l0 * k[GOAL_XV] + l1 * k[GOAL_YV] + l2 * k[GOAL_ZV]
    bu = m0 * k[GOAL_XU] + m1 * k[GOAL_YU] + m2 * k[GOAL_ZU]
    bv = m0 * k[GOAL_XV] + m1 * k[GOAL_YV] + m2 * k[GOAL_ZV]
    return (
        w * (matches.pixels[j, 0] - u),
        w * (matches.pixels[j, 1] - v),
        1.0 + au * au + av * av,
        au * bu + av * bv,
        1.0 + bu * bu + bv * bv,
        True,
    )


@leaf
def _write_outer(row: FloatArray, a: float, b: float, c: float, x: float, y: float, z: float) -> None:
    """Write (a, b, c)ᵀ(x, y, z) row by row: the derivative of (a, b, c)·G (x, y, z) by G."""
    row[XX], row[XY], row[XZ] = a * x, a * y, a * z
    row[YX], row[YY], row[YZ] = b * x, b * y, b * z
    row[ZX], row[ZY], row[ZZ] = c * x, c * y, c * z


@kernel
def map_distances(matches: Matches, matrix: FloatArray, distances: FloatArray) -> None:
    """Write the distances (n,) [px] of all matches to a map; see `map_distance`."""
    rows = np.empty((2, 9))
    for j in range(distances.shape[0]):
        distances[j] = map_distance(matches, j, matrix, rows)


@leaf
def map_distance(matches: Matches, j: int, matrix: FloatArray, rows: FloatArray) -> float:
    """Return √(eᵀ(I + AAᵀ)⁻¹e) [px] of match ``j``, infinite off the image; ``rows`` (2, 9): scratch."""
    eu, ev, suu, suv, svv, ok = _linearise_match(matches, j, 3, matrix, rows)
    if not ok:
        return math.inf
    square = eu * (svv * eu - suv * ev) + ev * (suu * ev - suv * eu)
    return math.sqrt(square / (suu * svv - suv * suv))


@kernel
def simpler_costs(matches: Matches, limits: FloatArray) -> FloatArray:
    """Return the costs (3,) [px²] of identity, rotation and homography as far as one may be below its limit.

    Each map is a special case of the next, so where the homography is far above all, so are the others; and
    where that of a few matches alone is, so is that of all.
    """
    costs = np.full(3, math.inf)
    largest = limits.max()
    if matches.pixels.shape[0] >= 2 * FEW:
        few = _every(matches, matches.pixels.shape[0] // FEW)
        some = np.ones(few.pixels.shape[0], dtype=np.bool_)
        matrix = algebraic_map(few.bearings, some, HOMOGRAPHY)
        least = refine_linear_map(few, HOMOGRAPHY, math.inf, largest, MOST_STEPS, matrix)
        if 2.0 * largest < least < math.inf:  # twice: the refinement may have ended a little early
            costs[HOMOGRAPHY] = least
            return costs
    everyone = np.ones(matches.pixels.shape[0], dtype=np.bool_)
    for kind in (HOMOGRAPHY, ROTATION, IDENTITY):
        matrix = algebraic_map(matches.bearings, everyone, kind)
        costs[kind] = refine_linear_map(matches, kind, math.inf, largest, MOST_STEPS, matrix)
        if kind == HOMOGRAPHY and costs[kind] > OUT_OF_REACH * largest:
            break
    return costs


@kernel
def _every(matches: Matches, stride: int) -> Matches:
    """Return each ``stride``-th match."""
    return Matches(
        matches.parameters,
        np.ascontiguousarray(matches.pixels[::stride]),
        np.ascontiguousarray(matches.weights[::stride]),
        np.ascontiguousarray(matches.bearings[::stride]),
        np.ascontiguousarray(matches.jacobians[::stride]),
        matches.noise_px,
    )


@kernel
def algebraic_map(bearings: FloatArray, members: BoolArray, kind: int) -> FloatArray:
    """Return the algebraic solution (3, 3): I, Horn's rotation (max Σ bᵀRb*), or the least Σ ‖b × G b*‖²."""
    if kind == ROTATION:
        return _horn_rotation(bearings, members)
    matrix = np.eye(3)
    if kind == HOMOGRAPHY:
        gram, vectors, values = np.zeros((9, 9)), np.empty((9, 2)), np.empty(2)
        for j in range(bearings.shape[0]):
            if members[j]:
                _add_across(bearings, j, gram)
        smallest_eigenvectors(gram, vectors, values)
        along = 0.0
        for i in range(9):
            matrix[i // 3, i % 3] = vectors[i, 0]
        for j in range(bearings.shape[0]):
            for i in range(9):
                along += bearings[j, i // 3] * matrix[i // 3, i % 3] * bearings[j, 3 + i % 3]
        if along < 0.0:  # the sign that maps most b* to b, not to −b
            for i in range(9):
                matrix[i // 3, i % 3] = -matrix[i // 3, i % 3]
    return matrix


@leaf
def _add_across(bearings: FloatArray, j: int, gram: FloatArray) -> None:
    """Add the lower triangle of (I − bbᵀ) ⊗ b*b*ᵀ, that of ‖b × G b*‖² in the entries of G."""
    for a in range(9):
        i, k = a // 3, a % 3
        for c in range(a + 1):
            m = c // 3
            across = (1.0 if i == m else 0.0) - bearings[j, i] * bearings[j, m]
            gram[a, c] += across * bearings[j, 3 + k] * bearings[j, 3 + c % 3]
            gram[c, a] = gram[a, c]


@kernel
def _horn_rotation(bearings: FloatArray, members: BoolArray) -> FloatArray:
    """Return the R with the largest Σ bᵀRb*: Horn's quaternion, 1987."""
    s = np.zeros((3, 3))
    for j in range(bearings.shape[0]):
        if members[j]:
            for i in range(9):
                s[i // 3, i % 3] += bearings[j, i // 3] * bearings[j, 3 + i % 3]
    horn = np.empty((4, 4))  # of (x, y, z, w), negated so that the sought vector comes first
    trace = s[0, 0] + s[1, 1] + s[2, 2]
    for i in range(3):
        for k in range(3):
            horn[i, k] = -(s[i, k] + s[k, i])
        horn[i, i] += trace
        j, k = (i + 1) % 3, (i + 2) % 3
        horn[i, 3] = -(s[k, j] - s[j, k])
        horn[3, i] = horn[i, 3]
    horn[3, 3] = -trace
    _, vectors = symmetric_eigen(horn)
    rotation = np.empty((3, 3))
    matrix_from_quaternion(vectors[0, 0], vectors[1, 0], vectors[2, 0], vectors[3, 0], rotation)
    return rotation
