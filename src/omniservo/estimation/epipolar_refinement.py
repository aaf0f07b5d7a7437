"""Refinement of the motion alone: the five parameters of E = [t]× R with the least Sampson distances in px.

The Sampson distance is to first order the reprojection error at the best structure, so this cost is that of
the joint refinement with the points already eliminated. It has no long curved valleys, and it needs no
structure to start from; the joint refinement then only has to remove what the first order leaves.
"""

import math

import numpy as np

from omniservo.estimation.rotation_parameters import matrix_from_quaternion
from omniservo.geometry.arrays import FloatArray
from omniservo.geometry.kernel import kernel
from omniservo.geometry.linear_systems import factor_cholesky, solve_factored

FIRST_DAMPING = 1e-3
LARGEST_DAMPING = 1e8
TRUSTED_DAMPING = 1e-2
SMALL_GAIN = 1e-5
"""A relative gain far below what noise can tell ends the refinement; the joint one follows anyway."""


@kernel
def essential_matrix(rotation: FloatArray, translation: FloatArray, essential: FloatArray) -> None:
    """Write E = [t]× R into ``essential`` (3, 3)."""
    for i in range(3):
        j, k = (i + 1) % 3, (i + 2) % 3
        for c in range(3):
            essential[i, c] = translation[j] * rotation[k, c] - translation[k] * rotation[j, c]


@kernel
def refine_epipolar(
    bearings: FloatArray,
    jacobians: FloatArray,
    loss_scale: float,
    rotation: FloatArray,
    translation: FloatArray,
    most_steps: int,
) -> tuple[float, bool]:
    """Refine ``rotation`` (3, 3) and the unit ``translation`` (3,) in place; return (cost [px²], converged).

    ``bearings`` (n, 6) holds (b, b*); ``jacobians`` (n, 12) their derivatives to the pixels, 3×2 row by row;
    ``loss_scale`` is the c [px] of the Cauchy loss, infinite for least squares. Levenberg-Marquardt on
    (δ, τ): R exp([δ]×) and t turned by τ in its tangent plane. The signs that E leaves free stay as given.
    """
    normal, gradient, factor, step = np.empty((5, 5)), np.empty(5), np.empty((5, 5)), np.empty(5)
    tangents, essential = np.empty((2, 3)), np.empty((3, 3))
    trial_r, trial_t = np.empty((3, 3)), np.empty(3)
    tangent_plane(translation, tangents)
    essential_matrix(rotation, translation, essential)
    cost = accumulate_distances(
        bearings, jacobians, loss_scale, rotation, essential, tangents, normal, gradient
    )
    damping = FIRST_DAMPING
    for _ in range(most_steps):
        if damping > LARGEST_DAMPING:
            break
        for i in range(5):
            for k in range(i):
                factor[i, k] = normal[i, k]
            factor[i, i] = (1.0 + damping) * normal[i, i]
            step[i] = -gradient[i]
        if not factor_cholesky(factor, 5, 1e-15):
            damping *= 10.0
            continue
        solve_factored(factor, 5, step)
        decrement = 0.0
        for i in range(5):
            decrement -= gradient[i] * step[i]
        move_motion(rotation, translation, tangents, step, trial_r, trial_t)
        essential_matrix(trial_r, trial_t, essential)
        trial = sampson_cost(bearings, jacobians, loss_scale, essential)
        last = decrement <= SMALL_GAIN * cost + 1e-20 * bearings.shape[0] and damping <= TRUSTED_DAMPING
        if trial <= cost or last:
            for i in range(3):
                translation[i] = trial_t[i]
                for k in range(3):
                    rotation[i, k] = trial_r[i, k]
            if last:
                return trial, True
            damping = max(0.1 * damping, 1e-12)
            tangent_plane(translation, tangents)
            cost = accumulate_distances(
                bearings, jacobians, loss_scale, rotation, essential, tangents, normal, gradient
            )
        else:
            damping = max(10.0 * damping, 1e-8)
    return cost, False


@kernel
def sampson_cost(
    bearings: FloatArray, jacobians: FloatArray, loss_scale: float, essential: FloatArray
) -> float:
    """Return Σ d² [px²], or the Cauchy loss of it, d the Sampson distances under ``essential``."""
    distances, weights = np.empty(bearings.shape[0]), np.empty(bearings.shape[0])
    sampson_distances(bearings, jacobians, essential, distances, weights)
    cost = 0.0
    for j in range(distances.shape[0]):
        square = distances[j] * distances[j]
        if loss_scale == math.inf:
            cost += square
        else:
            cost += loss_scale * loss_scale * math.log1p(square / (loss_scale * loss_scale))
    return cost


@kernel
def sampson_distances(
    bearings: FloatArray,
    jacobians: FloatArray,
    essential: FloatArray,
    distances: FloatArray,
    weights: FloatArray,
) -> None:
    """Write the signed Sampson distances (n,) [px] and the weights (n,) 1/‖∂(bᵀEb*)/∂(p, p*)‖².

    d = bᵀEb* over the length of that form's gradient in the four pixel coordinates: to first order the
    smallest correction of the pixels that satisfies E. The camera's Jacobians carry it, so that a pixel
    counts the same in the middle and at the rim.
    """
    e = essential
    for j in range(bearings.shape[0]):
        bx, by, bz = bearings[j, 0], bearings[j, 1], bearings[j, 2]
        gx, gy, gz = bearings[j, 3], bearings[j, 4], bearings[j, 5]
        lx = e[0, 0] * gx + e[0, 1] * gy + e[0, 2] * gz
        ly = e[1, 0] * gx + e[1, 1] * gy + e[1, 2] * gz
        lz = e[2, 0] * gx + e[2, 1] * gy + e[2, 2] * gz
        mx = e[0, 0] * bx + e[1, 0] * by + e[2, 0] * bz
        my = e[0, 1] * bx + e[1, 1] * by + e[2, 1] * bz
        mz = e[0, 2] * bx + e[1, 2] * by + e[2, 2] * bz
        square = 1e-300
        for c in range(2):
            first = lx * jacobians[j, c] + ly * jacobians[j, 2 + c] + lz * jacobians[j, 4 + c]
            second = mx * jacobians[j, 6 + c] + my * jacobians[j, 8 + c] + mz * jacobians[j, 10 + c]
            square += first * first + second * second
        weights[j] = 1.0 / square
        distances[j] = (bx * lx + by * ly + bz * lz) / math.sqrt(square)


@kernel
def tangent_plane(translation: FloatArray, tangents: FloatArray) -> None:
    """Write two orthonormal rows (2, 3) across the unit ``translation``."""
    smallest = 0
    for i in range(1, 3):
        if abs(translation[i]) < abs(translation[smallest]):
            smallest = i
    norm = math.sqrt(1.0 - translation[smallest] ** 2)
    j, k = (smallest + 1) % 3, (smallest + 2) % 3
    tangents[0, smallest] = 0.0
    tangents[0, j] = -translation[k] / norm
    tangents[0, k] = translation[j] / norm
    for i in range(3):
        a, b = (i + 1) % 3, (i + 2) % 3
        tangents[1, i] = translation[a] * tangents[0, b] - translation[b] * tangents[0, a]


@kernel
def move_motion(
    rotation: FloatArray,
    translation: FloatArray,
    tangents: FloatArray,
    step: FloatArray,
    trial_r: FloatArray,
    trial_t: FloatArray,
) -> None:
    """Write R turned by (δ/2, 1), which is exp([δ]×) to second order, and t moved in its tangent plane."""
    turn = np.empty((3, 3))
    matrix_from_quaternion(0.5 * step[0], 0.5 * step[1], 0.5 * step[2], 1.0, turn)
    norm = 0.0
    for i in range(3):
        for k in range(3):
            trial_r[i, k] = (
                rotation[i, 0] * turn[0, k] + rotation[i, 1] * turn[1, k] + rotation[i, 2] * turn[2, k]
            )
        trial_t[i] = translation[i] + step[3] * tangents[0, i] + step[4] * tangents[1, i]
        norm += trial_t[i] * trial_t[i]
    norm = 1.0 / math.sqrt(norm)
    for i in range(3):
        trial_t[i] *= norm


@kernel
def accumulate_distances(
    bearings: FloatArray,
    jacobians: FloatArray,
    loss_scale: float,
    rotation: FloatArray,
    essential: FloatArray,
    tangents: FloatArray,
    normal: FloatArray,
    gradient: FloatArray,
) -> float:
    """Fill JᵀJ (5, 5), lower triangle, and Jᵀd (5,) of the Sampson distances; return the cost."""
    normal[:, :] = 0.0
    gradient[:] = 0.0
    row = np.empty(5)
    cost = 0.0
    for j in range(bearings.shape[0]):
        distance = _sampson_row(bearings[j], jacobians[j], rotation, essential, tangents, row)
        square = distance * distance
        weight = 1.0
        if loss_scale == math.inf:
            cost += square
        else:
            cost += loss_scale * loss_scale * math.log1p(square / (loss_scale * loss_scale))
            weight = 1.0 / (1.0 + square / (loss_scale * loss_scale))
        for i in range(5):
            gradient[i] += weight * row[i] * distance
            for k in range(i + 1):
                normal[i, k] += weight * row[i] * row[k]
    return cost


@kernel
def _sampson_row(
    bearing: FloatArray,
    jacobian: FloatArray,
    rotation: FloatArray,
    e: FloatArray,
    tangents: FloatArray,
    row: FloatArray,
) -> float:
    """Return d = g/√q of one match and write its derivatives (5,) to (δ, τ).

    g = bᵀl, l = E b*, m = Eᵀ b, q = ‖Jᵀl‖² + ‖J*ᵀm‖². With a = b − (g/q) J Jᵀl and c = −(g/q) J*J*ᵀm,
    √q dd = a·dl + c·dm; dl = E (δ × b*), dm = m × δ under δ and dl = dt × R b*, dm = Rᵀ(b × dt) under a
    turn of t, so √q ∂d/∂δ = b* × Eᵀa + c × m and √q ∂d/∂t = R b* × a + R c × b.
    """
    b, g = bearing[:3], bearing[3:]
    line, m, turned, a, c = np.empty(3), np.empty(3), np.empty(3), np.empty(3), np.empty(3)
    _apply(e, g, False, line)
    _apply(e, b, True, m)
    _apply(rotation, g, False, turned)
    f0 = line[0] * jacobian[0] + line[1] * jacobian[2] + line[2] * jacobian[4]
    f1 = line[0] * jacobian[1] + line[1] * jacobian[3] + line[2] * jacobian[5]
    f2 = m[0] * jacobian[6] + m[1] * jacobian[8] + m[2] * jacobian[10]
    f3 = m[0] * jacobian[7] + m[1] * jacobian[9] + m[2] * jacobian[11]
    q = f0 * f0 + f1 * f1 + f2 * f2 + f3 * f3 + 1e-300
    form = line[0] * b[0] + line[1] * b[1] + line[2] * b[2]
    scale = 1.0 / math.sqrt(q)
    ratio = form / q
    for i in range(3):
        a[i] = b[i] - ratio * (f0 * jacobian[2 * i] + f1 * jacobian[2 * i + 1])
        c[i] = -ratio * (f2 * jacobian[6 + 2 * i] + f3 * jacobian[7 + 2 * i])
    ea, rc = np.empty(3), np.empty(3)
    _apply(e, a, True, ea)
    _apply(rotation, c, False, rc)
    row[3] = 0.0
    row[4] = 0.0
    for i in range(3):
        j, k = (i + 1) % 3, (i + 2) % 3
        row[i] = scale * (g[j] * ea[k] - g[k] * ea[j] + c[j] * m[k] - c[k] * m[j])
        slope = scale * (turned[j] * a[k] - turned[k] * a[j] + rc[j] * b[k] - rc[k] * b[j])
        row[3] += tangents[0, i] * slope
        row[4] += tangents[1, i] * slope
    distance: float = form * scale
    return distance


@kernel
def _apply(matrix: FloatArray, vector: FloatArray, transposed: bool, product: FloatArray) -> None:
    """Write the product of a 3×3 matrix, or its transpose, and a vector."""
    for i in range(3):
        if transposed:
            product[i] = matrix[0, i] * vector[0] + matrix[1, i] * vector[1] + matrix[2, i] * vector[2]
        else:
            product[i] = matrix[i, 0] * vector[0] + matrix[i, 1] * vector[1] + matrix[i, 2] * vector[2]
