"""Refinement of the motion alone: the five parameters of E = [t]× R with the least Sampson distances in px.

The Sampson distance is to first order the reprojection error at the best structure, so this cost is that of
the joint refinement with the points already eliminated. It has no long curved valleys, and it needs no
structure to start from; the joint refinement then only has to remove what the first order leaves.
"""

import math

import numpy as np

from omniservo.estimation.linear_systems import factor_cholesky, solve_factored
from omniservo.estimation.rotation_parameters import matrix_from_quaternion
from omniservo.geometry.arrays import FloatArray
from omniservo.geometry.kernel import kernel

FIRST_DAMPING = 1e-3
LARGEST_DAMPING = 1e8


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
    _tangent_plane(translation, tangents)
    essential_matrix(rotation, translation, essential)
    cost = _accumulate(bearings, jacobians, loss_scale, rotation, essential, tangents, normal, gradient)
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
        _move(rotation, translation, tangents, step, trial_r, trial_t)
        essential_matrix(trial_r, trial_t, essential)
        trial = sampson_cost(bearings, jacobians, loss_scale, essential)
        last = decrement <= 1e-9 * cost + 1e-20 * bearings.shape[0]
        if trial <= cost or last:
            rotation[:, :] = trial_r
            translation[:] = trial_t
            if last:
                return trial, True
            damping = max(0.1 * damping, 1e-12)
            _tangent_plane(translation, tangents)
            cost = _accumulate(
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
def _tangent_plane(translation: FloatArray, tangents: FloatArray) -> None:
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
def _move(
    rotation: FloatArray,
    translation: FloatArray,
    tangents: FloatArray,
    step: FloatArray,
    trial_r: FloatArray,
    trial_t: FloatArray,
) -> None:
    """Write R turned by (δ/2, 1), which is exp([δ]×) to second order, and t moved in its tangent plane."""
    turn = np.empty((3, 3))
    matrix_from_quaternion(np.array([0.5 * step[0], 0.5 * step[1], 0.5 * step[2], 1.0]), turn)
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
def _accumulate(
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

    g = bᵀl, l = E b*, m = Eᵀ b, q = ‖Jᵀl‖² + ‖J*ᵀm‖². Under δ: dl = E (δ × b*), dm = m × δ; under a turn of t
    by dt: dl = dt × R b*, dm = Rᵀ(b × dt).
    """
    line, turned, other, dl, dm = np.empty(3), np.empty(3), np.empty(3), np.empty(3), np.empty(3)
    for i in range(3):
        line[i] = e[i, 0] * bearing[3] + e[i, 1] * bearing[4] + e[i, 2] * bearing[5]
        turned[i] = rotation[i, 0] * bearing[3] + rotation[i, 1] * bearing[4] + rotation[i, 2] * bearing[5]
        other[i] = e[0, i] * bearing[0] + e[1, i] * bearing[1] + e[2, i] * bearing[2]
    f0 = line[0] * jacobian[0] + line[1] * jacobian[2] + line[2] * jacobian[4]
    f1 = line[0] * jacobian[1] + line[1] * jacobian[3] + line[2] * jacobian[5]
    f2 = other[0] * jacobian[6] + other[1] * jacobian[8] + other[2] * jacobian[10]
    f3 = other[0] * jacobian[7] + other[1] * jacobian[9] + other[2] * jacobian[11]
    q = f0 * f0 + f1 * f1 + f2 * f2 + f3 * f3 + 1e-300
    g = line[0] * bearing[0] + line[1] * bearing[1] + line[2] * bearing[2]
    scale = 1.0 / math.sqrt(q)
    for c in range(5):
        if c < 3:
            a, b = (c + 1) % 3, (c + 2) % 3
            for i in range(3):
                dl[i] = e[i, b] * bearing[3 + a] - e[i, a] * bearing[3 + b]
            dm[c], dm[a], dm[b] = 0.0, other[b], -other[a]
        else:
            t0, t1, t2 = tangents[c - 3, 0], tangents[c - 3, 1], tangents[c - 3, 2]
            dl[0], dl[1], dl[2] = (
                t1 * turned[2] - t2 * turned[1],
                t2 * turned[0] - t0 * turned[2],
                t0 * turned[1] - t1 * turned[0],
            )
            x, y, z = (
                bearing[1] * t2 - bearing[2] * t1,
                bearing[2] * t0 - bearing[0] * t2,
                bearing[0] * t1 - bearing[1] * t0,
            )
            for i in range(3):
                dm[i] = rotation[0, i] * x + rotation[1, i] * y + rotation[2, i] * z
        dg = dl[0] * bearing[0] + dl[1] * bearing[1] + dl[2] * bearing[2]
        dq = f0 * (dl[0] * jacobian[0] + dl[1] * jacobian[2] + dl[2] * jacobian[4])
        dq += f1 * (dl[0] * jacobian[1] + dl[1] * jacobian[3] + dl[2] * jacobian[5])
        dq += f2 * (dm[0] * jacobian[6] + dm[1] * jacobian[8] + dm[2] * jacobian[10])
        dq += f3 * (dm[0] * jacobian[7] + dm[1] * jacobian[9] + dm[2] * jacobian[11])
        row[c] = scale * (dg - g * dq / q)
    distance: float = g * scale
    return distance
