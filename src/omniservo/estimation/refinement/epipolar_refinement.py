"""Refinement of the motion alone: the five parameters of E = [t]× R with the least Sampson distances in px.

The Sampson distance is to first order the reprojection error at the best structure, so this cost is that of
the joint refinement with the points already eliminated. It has no long curved valleys, and it needs no
structure to start from; the joint refinement then only has to remove what the first order leaves.
"""

import math

import numpy as np

from omniservo.estimation.minimal_solvers.essential_matrix import (
    GOAL_XU,
    GOAL_XV,
    GOAL_YU,
    GOAL_YV,
    GOAL_ZU,
    GOAL_ZV,
    XU,
    XV,
    YU,
    YV,
    ZU,
    ZV,
)
from omniservo.estimation.refinement.pose_refinement import cauchy_loss
from omniservo.geometry.arrays import FloatArray
from omniservo.geometry.kernel import kernel, leaf
from omniservo.geometry.linear_systems import factor_cholesky, solve_factored
from omniservo.geometry.matrix_products import times, transposed_times
from omniservo.geometry.quaternions import matrix_from_quaternion

FIRST_DAMPING = 1e-5
LARGEST_DAMPING = 1e8
TRUSTED_DAMPING = 1e-2
SMALL_GAIN = 1e-5
"""A relative gain far below what noise can tell ends the refinement; the joint one follows anyway."""


@leaf
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

    ``bearings`` (n, 6) holds (b, b*); ``jacobians`` (n, 12) their derivatives to the pixels;
    ``loss_scale`` is the c [px] of the Cauchy loss, infinite for least squares. Levenberg-Marquardt on
    (δ, τ): R exp([δ]×) and t turned by τ in its tangent plane. The signs that E leaves free stay as given.
    """
    normal, gradient, factor, step = np.empty((5, 5)), np.empty(5), np.empty((5, 5)), np.empty(5)
    trial_normal, trial_gradient = np.empty((5, 5)), np.empty(5)
    tangents, trial_tangents, essential = np.empty((2, 3)), np.empty((2, 3)), np.empty((3, 3))
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
        decrement = _damped_step(normal, gradient, damping, factor, step)
        if decrement < 0.0:
            damping *= 10.0
            continue
        move_motion(rotation, translation, tangents, step, trial_r, trial_t)
        essential_matrix(trial_r, trial_t, essential)
        tangent_plane(trial_t, trial_tangents)
        # Most trials are taken, so their normal equations are made along with their cost.
        trial = accumulate_distances(
            bearings,
            jacobians,
            loss_scale,
            trial_r,
            essential,
            trial_tangents,
            trial_normal,
            trial_gradient,
        )
        last = decrement <= SMALL_GAIN * cost + 1e-20 * bearings.shape[0] and damping <= TRUSTED_DAMPING
        if trial <= cost or last:
            for i in range(3):
                translation[i] = trial_t[i]
                for k in range(3):
                    rotation[i, k] = trial_r[i, k]
            if last:
                return trial, True
            damping, cost = max(0.1 * damping, 1e-12), trial
            normal, trial_normal = trial_normal, normal
            gradient, trial_gradient = trial_gradient, gradient
            tangents, trial_tangents = trial_tangents, tangents
        else:
            damping = max(10.0 * damping, 1e-8)
    return cost, False


@leaf
def _damped_step(
    normal: FloatArray, gradient: FloatArray, damping: float, factor: FloatArray, step: FloatArray
) -> float:
    """Write the damped step (5,) and return −gradient·step, or −1 where the system is singular."""
    for i in range(5):
        for k in range(i):
            factor[i, k] = normal[i, k]
        factor[i, i] = (1.0 + damping) * normal[i, i]
        step[i] = -gradient[i]
    if not factor_cholesky(factor, 5, 1e-15):
        return -1.0
    solve_factored(factor, 5, step)
    decrement = 0.0
    for i in range(5):
        decrement -= gradient[i] * step[i]
    return decrement


@leaf
def sampson_distance(bearings: FloatArray, jacobians: FloatArray, j: int, e: FloatArray) -> float:
    """Return match ``j``'s signed Sampson distance [px].

    d = bᵀEb* over the length of that form's gradient in the four pixel coordinates: to first order the
    smallest correction of the pixels that satisfies E. The camera's Jacobians carry it, so that a pixel
    counts the same in the middle and at the rim.
    """
    form, f0, f1, f2, f3 = sampson_gradient(bearings, jacobians, j, e)
    return form / math.sqrt(f0 * f0 + f1 * f1 + f2 * f2 + f3 * f3 + 1e-300)


@leaf
def sampson_gradient(
    bearings: FloatArray, jacobians: FloatArray, j: int, e: FloatArray
) -> tuple[float, float, float, float, float]:
    """Return bᵀEb* of match ``j`` and its gradient in the pixels (u, v, u*, v*)."""
    k = jacobians[j]
    bx, by, bz = bearings[j, 0], bearings[j, 1], bearings[j, 2]
    lx, ly, lz = times(e, bearings[j, 3], bearings[j, 4], bearings[j, 5])
    mx, my, mz = transposed_times(e, bx, by, bz)
    return (
        bx * lx + by * ly + bz * lz,
        lx * k[XU] + ly * k[YU] + lz * k[ZU],
        lx * k[XV] + ly * k[YV] + lz * k[ZV],
        mx * k[GOAL_XU] + my * k[GOAL_YU] + mz * k[GOAL_ZU],
        mx * k[GOAL_XV] + my * k[GOAL_YV] + mz * k[GOAL_ZV],
    )


@leaf
def sampson_distances(
    bearings: FloatArray, jacobians: FloatArray, essential: FloatArray, distances: FloatArray
) -> None:
    """Write the signed Sampson distances (n,) [px]; see :func:`sampson_distance`."""
    for j in range(bearings.shape[0]):
        distances[j] = sampson_distance(bearings, jacobians, j, essential)


@leaf
def sampson_cost(
    bearings: FloatArray, jacobians: FloatArray, loss_scale: float, essential: FloatArray
) -> float:
    """Return Σ d² [px²], or the Cauchy loss of it, d the Sampson distances under ``essential``."""
    cost = 0.0
    for j in range(bearings.shape[0]):
        distance = sampson_distance(bearings, jacobians, j, essential)
        cost += cauchy_loss(distance * distance, loss_scale)
    return cost


@leaf
def correct_bearings(
    bearings: FloatArray, jacobians: FloatArray, essential: FloatArray, corrected: FloatArray
) -> None:
    """Write the bearings (n, 6), to first order those of the nearest pixels that satisfy E."""
    for j in range(bearings.shape[0]):
        b, k = bearings[j], jacobians[j]
        form, f0, f1, f2, f3 = sampson_gradient(bearings, jacobians, j, essential)
        ratio = form / (f0 * f0 + f1 * f1 + f2 * f2 + f3 * f3 + 1e-300)
        for i in range(3):
            corrected[j, i] = b[i] - ratio * (f0 * k[XU + 2 * i] + f1 * k[XV + 2 * i])
            corrected[j, 3 + i] = b[3 + i] - ratio * (f2 * k[GOAL_XU + 2 * i] + f3 * k[GOAL_XV + 2 * i])


@leaf
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
    row = np.empty(5)
    normal[:, :] = 0.0
    gradient[:] = 0.0
    cost = 0.0
    for j in range(bearings.shape[0]):
        distance = sampson_row(bearings, jacobians, j, rotation, essential, tangents, row)
        square = distance * distance
        weight = 1.0
        if loss_scale == math.inf:
            cost += square
        else:
            cost += cauchy_loss(square, loss_scale)
            weight = 1.0 / (1.0 + square / (loss_scale * loss_scale))
        for i in range(5):
            weighted = weight * row[i]
            gradient[i] += weighted * distance
            for k in range(i + 1):
                normal[i, k] += weighted * row[k]
    return cost


@leaf
def sampson_row(
    bearings: FloatArray,
    jacobians: FloatArray,
    j: int,
    r: FloatArray,
    e: FloatArray,
    tangents: FloatArray,
    row: FloatArray,
) -> float:
    """Return d = g/√q of match ``j`` and write its derivatives (5,) to (δ, τ).

    g = bᵀl, l = E b*, m = Eᵀ b, q = ‖Jᵀl‖² + ‖J*ᵀm‖². With a = b − (g/q) J Jᵀl and c = −(g/q) J*J*ᵀm,
    √q dd = a·dl + c·dm; dl = E (δ × b*), dm = m × δ under δ and dl = dt × R b*, dm = Rᵀ(b × dt) under a
    turn of t, so √q ∂d/∂δ = b* × Eᵀa + c × m and √q ∂d/∂t = R b* × a + R c × b.
    """
    bx, by, bz = bearings[j, 0], bearings[j, 1], bearings[j, 2]
    gx, gy, gz = bearings[j, 3], bearings[j, 4], bearings[j, 5]
    k = jacobians[j]
    j0, j1, j2, j3, j4, j5 = k[XU], k[XV], k[YU], k[YV], k[ZU], k[ZV]
    k0, k1, k2, k3, k4, k5 = k[GOAL_XU], k[GOAL_XV], k[GOAL_YU], k[GOAL_YV], k[GOAL_ZU], k[GOAL_ZV]
    lx, ly, lz = times(e, gx, gy, gz)
    mx, my, mz = transposed_times(e, bx, by, bz)
    f0, f1 = lx * j0 + ly * j2 + lz * j4, lx * j1 + ly * j3 + lz * j5
    f2, f3 = mx * k0 + my * k2 + mz * k4, mx * k1 + my * k3 + mz * k5
    q = f0 * f0 + f1 * f1 + f2 * f2 + f3 * f3 + 1e-300
    form = lx * bx + ly * by + lz * bz
    scale, ratio = 1.0 / math.sqrt(q), form / q
    f0, f1, f2, f3 = ratio * f0, ratio * f1, ratio * f2, ratio * f3
    ax, ay, az = bx - (f0 * j0 + f1 * j1), by - (f0 * j2 + f1 * j3), bz - (f0 * j4 + f1 * j5)
    cx, cy, cz = -(f2 * k0 + f3 * k1), -(f2 * k2 + f3 * k3), -(f2 * k4 + f3 * k5)
    ex, ey, ez = transposed_times(e, ax, ay, az)
    row[0] = scale * (gy * ez - gz * ey + cy * mz - cz * my)
    row[1] = scale * (gz * ex - gx * ez + cz * mx - cx * mz)
    row[2] = scale * (gx * ey - gy * ex + cx * my - cy * mx)
    hx, hy, hz = times(r, gx, gy, gz)
    ux, uy, uz = times(r, cx, cy, cz)
    sx = scale * (hy * az - hz * ay + uy * bz - uz * by)
    sy = scale * (hz * ax - hx * az + uz * bx - ux * bz)
    sz = scale * (hx * ay - hy * ax + ux * by - uy * bx)
    row[3] = tangents[0, 0] * sx + tangents[0, 1] * sy + tangents[0, 2] * sz
    row[4] = tangents[1, 0] * sx + tangents[1, 1] * sy + tangents[1, 2] * sz
    distance: float = form * scale
    return distance
