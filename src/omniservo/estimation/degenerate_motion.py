"""Motions and targets that two views cannot resolve: none, a pure rotation, a plane.

All three say b ∝ G b* for one matrix G: the identity, a rotation, a homography. G is fitted in px with its
first-order maximum-likelihood cost  Σ eᵀ(I + AAᵀ)⁻¹e,  e = p − π(G b*), A = ∂π(G b*)/∂p*, so its cost can be
compared with that of motion and structure.
"""

import math

import numpy as np

from omniservo.cameras.unified_kernels import project_point_jacobian
from omniservo.estimation.rotation_parameters import matrix_from_quaternion
from omniservo.geometry.arrays import FloatArray
from omniservo.geometry.kernel import kernel
from omniservo.geometry.linear_systems import factor_cholesky, solve_factored

IDENTITY = 0
ROTATION = 1
HOMOGRAPHY = 2
MOST_STEPS = 8


@kernel
def refine_linear_map(
    parameters: FloatArray,
    pixels: FloatArray,
    weights: FloatArray,
    bearings: FloatArray,
    jacobians: FloatArray,
    kind: int,
    matrix: FloatArray,
) -> float:
    """Refine G (3, 3) in place and return its cost [px²], infinite where it leaves the domain.

    ``pixels`` (n, 4), ``weights`` (n, 2), ``bearings`` (n, 6) and ``jacobians`` (n, 12) are those of
    `Matches`. Gauss-Newton; a step that does not lower the cost ends it.
    """
    size = 3 if kind == ROTATION else 9
    normal, gradient = np.empty((9, 9)), np.empty(9)
    cost = _accumulate(parameters, pixels, weights, bearings, jacobians, size, matrix, normal, gradient)
    if kind == IDENTITY:
        return cost
    trial, turn = np.empty((3, 3)), np.empty((3, 3))
    for _ in range(MOST_STEPS):
        if not cost < math.inf:
            break
        if kind == HOMOGRAPHY:
            _hold_scale(matrix, normal)
        if not factor_cholesky(normal, size, 1e-13):
            break
        solve_factored(normal, size, gradient)
        _step(kind, matrix, gradient, turn, trial)
        lower = _accumulate(parameters, pixels, weights, bearings, jacobians, size, trial, normal, gradient)
        if not lower < cost:
            break
        small = cost - lower < 1e-6 * cost
        cost = lower
        for i in range(9):
            matrix[i // 3, i % 3] = trial[i // 3, i % 3]
        if small:
            break
    return cost


@kernel
def _hold_scale(g: FloatArray, normal: FloatArray) -> None:
    """Add a penalty along G itself: the cost does not depend on its norm."""
    weight = 0.0
    for i in range(9):
        weight += normal[i, i]
    for i in range(9):
        for k in range(i + 1):
            normal[i, k] += weight * g[i // 3, i % 3] * g[k // 3, k % 3]


@kernel
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
    parameters: FloatArray,
    pixels: FloatArray,
    weights: FloatArray,
    bearings: FloatArray,
    jacobians: FloatArray,
    size: int,
    g: FloatArray,
    normal: FloatArray,
    gradient: FloatArray,
) -> float:
    """Fill the normal equations (lower triangle; δ for size 3, dG row by row for 9); return the cost."""
    normal[:, :] = 0.0
    gradient[:] = 0.0
    rows, a, jp, b, c = np.empty((2, 9)), np.empty((2, 2)), np.empty((2, 3)), np.empty(3), np.empty(3)
    cost = 0.0
    for j in range(pixels.shape[0]):
        for i in range(3):
            b[i] = bearings[j, 3 + i]
        for i in range(3):
            c[i] = g[i, 0] * b[0] + g[i, 1] * b[1] + g[i, 2] * b[2]
        u, v, jp[0, 0], jp[0, 1], jp[0, 2], jp[1, 0], jp[1, 1], jp[1, 2], ok = project_point_jacobian(
            parameters, c[0], c[1], c[2]
        )
        if not ok:
            return math.inf
        w = weights[j, 0]
        eu, ev = w * (pixels[j, 0] - u), w * (pixels[j, 1] - v)
        for r in range(2):
            for i in range(3):
                jp[r, i] *= w
            m0 = jp[r, 0] * g[0, 0] + jp[r, 1] * g[1, 0] + jp[r, 2] * g[2, 0]
            m1 = jp[r, 0] * g[0, 1] + jp[r, 1] * g[1, 1] + jp[r, 2] * g[2, 1]
            m2 = jp[r, 0] * g[0, 2] + jp[r, 1] * g[1, 2] + jp[r, 2] * g[2, 2]
            for k in range(2):
                a[r, k] = m0 * jacobians[j, 6 + k] + m1 * jacobians[j, 8 + k] + m2 * jacobians[j, 10 + k]
            if size == 3:  # dc = R (δ × b) = −R [b]× δ, and mᵀ(δ × b) = δ·(b × m)
                rows[r, 0] = b[1] * m2 - b[2] * m1
                rows[r, 1] = b[2] * m0 - b[0] * m2
                rows[r, 2] = b[0] * m1 - b[1] * m0
            else:
                for i in range(9):
                    rows[r, i] = jp[r, i // 3] * b[i % 3]
        suu = 1.0 + a[0, 0] * a[0, 0] + a[0, 1] * a[0, 1]
        suv = a[0, 0] * a[1, 0] + a[0, 1] * a[1, 1]
        svv = 1.0 + a[1, 0] * a[1, 0] + a[1, 1] * a[1, 1]
        f = 1.0 / (suu * svv - suv * suv)
        wu, wv = f * (svv * eu - suv * ev), f * (suu * ev - suv * eu)
        cost += eu * wu + ev * wv
        for i in range(size):
            gradient[i] += rows[0, i] * wu + rows[1, i] * wv
            x = f * (svv * rows[0, i] - suv * rows[1, i])
            y = f * (suu * rows[1, i] - suv * rows[0, i])
            for k in range(i + 1):
                normal[i, k] += x * rows[0, k] + y * rows[1, k]
    return cost


def algebraic_map(bearings: FloatArray, kind: int) -> FloatArray:
    """Return the algebraic solution (3, 3): I, Horn's rotation (max Σ bᵀRb*), or the least Σ ‖b × G b*‖²."""
    initial, goal = bearings[:, :3], bearings[:, 3:]
    if kind == IDENTITY:
        return np.eye(3)
    if kind == ROTATION:
        u, _, vt = np.linalg.svd(initial.T @ goal)
        handed = np.array([1.0, 1.0, np.linalg.det(u) * np.linalg.det(vt)])
        return np.ascontiguousarray((u * handed) @ vt)
    across = np.eye(3) - initial[:, :, None] * initial[:, None, :]
    gram = np.einsum("nij,nk,nl->ikjl", across, goal, goal).reshape(9, 9)
    g = np.linalg.eigh(gram)[1][:, 0].reshape(3, 3)
    # The sign that maps most b* to b, not to −b.
    return np.ascontiguousarray(math.copysign(1.0, float(np.sum((initial @ g) * goal))) * g)
