"""Kernels that refine the camera's pose from one image of known points (perspective-n-point)."""

import math
from typing import NamedTuple

import numpy as np

from omniservo.cameras.unified_kernels import project_point, project_point_jacobian
from omniservo.geometry.arrays import BoolArray, FloatArray
from omniservo.geometry.kernel import kernel, leaf
from omniservo.geometry.linear_systems import factor_cholesky, invert_factored, solve_factored
from omniservo.geometry.matrix_products import times, transposed_times
from omniservo.geometry.quaternions import matrix_from_quaternion, turn_quaternion

LEAST_POINTS = 4
"""Three points leave up to four poses and nothing to check them by."""

MOST_STEPS = 200
"""Accepted and rejected; ten are enough but where a plane's two poses are about to become one: there the
valley is flat, and 60 were too few for one image of a small tag in some thousands."""

ROBUST_STEPS = 6
LEAST_PIVOT = 1e-12
SMALLEST_STEP = 1e-11
FLAT_VALLEY = 1e-4


class PoseEquations(NamedTuple):
    """The normal equations of a pose in (dt, δ), δ the rotation vector applied on the right of R."""

    normal: FloatArray
    """JᵀJ (6, 6)"""
    gradient: FloatArray
    """Jᵀr (6,)"""


@kernel
def refine_pose_kernel(
    parameters: FloatArray,
    points: FloatArray,
    pixels: FloatArray,
    valid: BoolArray,
    quaternion: FloatArray,
    translation: FloatArray,
) -> tuple[FloatArray, FloatArray, float, bool]:
    """Return (quaternion (4,), translation (3,), rms_px, ok): `refine_pose` on plain arrays.

    ``parameters`` are the camera's; (``quaternion``, ``translation``) is reference_T_camera, scalar last.
    Where ok is False the guess comes back with rms_px infinite or that of the last pose.
    """
    weights = np.empty(valid.shape[0])
    count = _weigh(valid, weights)
    if count < LEAST_POINTS:
        return quaternion.copy(), translation.copy(), math.inf, False
    q, t, cost, ok = minimise_pose(parameters, points, pixels, weights, math.inf, quaternion, translation)
    if not ok:
        return quaternion.copy(), translation.copy(), math.sqrt(cost / count), False
    return q, t, math.sqrt(cost / count), True


@leaf
def _weigh(valid: BoolArray, weights: FloatArray) -> int:
    """Write 1 for what is valid and 0 for the rest; return how many are valid."""
    count = 0
    for j in range(valid.shape[0]):
        weights[j] = 1.0 if valid[j] else 0.0
        count += 1 if valid[j] else 0
    return count


@kernel
def minimise_pose(
    parameters: FloatArray,
    points: FloatArray,
    pixels: FloatArray,
    weights: FloatArray,
    loss_scale: float,
    quaternion: FloatArray,
    translation: FloatArray,
) -> tuple[FloatArray, FloatArray, float, bool]:
    """Return (quaternion, translation, cost, ok) that minimise Σ ρ(‖wⱼ(π(Rᵀ(hⱼ − t)) − pⱼ)‖²).

    ``weights`` (n,) are wⱼ, 0 leaves a point out (its pixel may be NaN); ρ is the Cauchy loss
    c² log(1 + r²/c²) of scale c = ``loss_scale``, or r² where that is infinite. With the loss, which
    serves to choose points, there are few steps. In a flat valley the search ends, ok, where a step would
    gain less than 10⁻⁴ of the cost. Where ok is False the last pose comes back, with its cost: infinite where
    the guess puts a point outside the camera's domain.
    """
    q = turn_quaternion(quaternion, 0.0, 0.0, 0.0)
    t = translation.copy()
    equations, factor, step = PoseEquations(np.empty((6, 6)), np.empty(6)), np.empty((6, 6)), np.empty(6)
    normal, gradient = equations.normal, equations.gradient
    cost = normal_equations(parameters, points, pixels, weights, loss_scale, q, t, equations)
    if not cost < math.inf:
        return q, t, math.inf, False
    damping, decrement = 0.0, math.inf
    trial_t = np.empty(3)
    for _ in range(MOST_STEPS if loss_scale == math.inf else ROBUST_STEPS):
        for i in range(6):
            for k in range(6):
                factor[i, k] = normal[i, k]
            factor[i, i] += damping * normal[i, i]
            step[i] = -gradient[i]
        if not factor_cholesky(factor, 6, LEAST_PIVOT):
            if damping > 1.0:
                break
            damping = max(10.0 * damping, 1e-6)
            continue
        solve_factored(factor, 6, step)
        trial_q = turn_quaternion(q, step[3], step[4], step[5])
        for i in range(3):
            trial_t[i] = t[i] + step[i]
        trial = pose_cost(parameters, points, pixels, weights, loss_scale, trial_q, trial_t)
        decrement = 0.0
        for i in range(6):
            decrement -= gradient[i] * step[i]
        # The cost cannot show a change below its rounding: such a step is taken and is the last.
        last = decrement <= 1e-12 * cost + SMALLEST_STEP * SMALLEST_STEP * points.shape[0]
        if trial <= cost or (last and trial < math.inf):
            q = trial_q
            for i in range(3):
                t[i] = trial_t[i]
            cost = normal_equations(parameters, points, pixels, weights, loss_scale, q, t, equations)
            if last:
                return q, t, cost, factor_cholesky(normal, 6, LEAST_PIVOT)
            damping = 0.1 * damping if damping > 1e-6 else 0.0
        else:
            damping = max(10.0 * damping, 1e-4)
    flat = decrement <= FLAT_VALLEY * cost and damping <= 1e-4
    return q, t, cost, flat and factor_cholesky(normal, 6, LEAST_PIVOT)


@kernel
def pose_cost(
    parameters: FloatArray,
    points: FloatArray,
    pixels: FloatArray,
    weights: FloatArray,
    loss_scale: float,
    q: FloatArray,
    t: FloatArray,
) -> float:
    """Return the cost that `minimise_pose` minimises; infinity where a point leaves the domain."""
    r = np.empty((3, 3))
    matrix_from_quaternion(q[0], q[1], q[2], q[3], r)
    cost = 0.0
    for j in range(points.shape[0]):
        if weights[j] == 0.0:
            continue
        x, y, z = points[j, 0] - t[0], points[j, 1] - t[1], points[j, 2] - t[2]
        x, y, z = transposed_times(r, x, y, z)
        u, v, ok = project_point(parameters, x, y, z)
        if not ok:
            return math.inf
        square = weights[j] * weights[j] * ((u - pixels[j, 0]) ** 2 + (v - pixels[j, 1]) ** 2)
        cost += cauchy_loss(square, loss_scale)
    return cost


@leaf
def cauchy_loss(square: float, scale: float) -> float:
    """Return the Cauchy loss of a squared residual [px²]; the square itself for an infinite scale."""
    if scale == math.inf:
        return square
    return scale * scale * math.log1p(square / (scale * scale))


@kernel
def normal_equations(
    parameters: FloatArray,
    points: FloatArray,
    pixels: FloatArray,
    weights: FloatArray,
    loss_scale: float,
    q: FloatArray,
    t: FloatArray,
    equations: PoseEquations,
) -> float:
    """Fill the normal equations and return the cost, or infinity outside the domain.

    c = Rᵀ(h − t) with R ← R exp([δ]×): dc = −Rᵀ dt + [c]× δ.
    """
    normal, gradient = equations.normal, equations.gradient
    r = np.empty((3, 3))
    matrix_from_quaternion(q[0], q[1], q[2], q[3], r)
    normal[:, :] = 0.0
    gradient[:] = 0.0
    row = np.empty((2, 6))
    cost = 0.0
    for j in range(points.shape[0]):
        if weights[j] == 0.0:
            continue
        hx, hy, hz = points[j, 0] - t[0], points[j, 1] - t[1], points[j, 2] - t[2]
        x, y, z = transposed_times(r, hx, hy, hz)
        u, v, j00, j01, j02, j10, j11, j12, ok = project_point_jacobian(parameters, x, y, z)
        if not ok:
            return math.inf
        pose_row(row[0], r, x, y, z, j00, j01, j02)
        pose_row(row[1], r, x, y, z, j10, j11, j12)
        du, dv = u - pixels[j, 0], v - pixels[j, 1]
        weight = weights[j] * weights[j]
        square = weight * (du * du + dv * dv)
        cost += cauchy_loss(square, loss_scale)
        if loss_scale < math.inf:
            weight /= 1.0 + square / (loss_scale * loss_scale)
        for a in range(6):
            x, y = weight * row[0, a], weight * row[1, a]
            gradient[a] += x * du + y * dv
            for b in range(a + 1):
                normal[a, b] += x * row[0, b] + y * row[1, b]
    for a in range(6):
        for b in range(a):
            normal[b, a] = normal[a, b]
    return cost


@leaf
def pose_row(
    row: FloatArray, r: FloatArray, x: float, y: float, z: float, jx: float, jy: float, jz: float
) -> None:
    """Write j·[−Rᵀ, [c]×] (6,): a pixel coordinate's derivative to (dt, δ) from j, that to c = (x, y, z)."""
    tx, ty, tz = times(r, jx, jy, jz)
    row[0], row[1], row[2] = -tx, -ty, -tz
    row[3] = jy * z - jz * y
    row[4] = jz * x - jx * z
    row[5] = jx * y - jy * x


@kernel
def pose_covariance(
    parameters: FloatArray,
    points: FloatArray,
    pixels: FloatArray,
    valid: BoolArray,
    q: FloatArray,
    t: FloatArray,
    least_variance: float,
    covariance: FloatArray,
) -> bool:
    """Write σ²(JᵀJ)⁻¹ into ``covariance`` (6, 6); False where JᵀJ is singular.

    σ² = Σr²/(2n − 6) over the valid points, at least ``least_variance`` [px²].
    """
    weights = np.empty(valid.shape[0])
    count = _weigh(valid, weights)
    cost = inverse_information(parameters, points, pixels, weights, q, t, covariance)
    if not cost < math.inf:
        return False
    variance = max(cost / (2 * count - 6), least_variance)
    for i in range(6):
        for k in range(6):
            covariance[i, k] *= variance
    return True


@kernel
def inverse_information(
    parameters: FloatArray,
    points: FloatArray,
    pixels: FloatArray,
    weights: FloatArray,
    q: FloatArray,
    t: FloatArray,
    covariance: FloatArray,
) -> float:
    """Write (JᵀWJ)⁻¹ (6, 6) of (dt, δ), for residuals of variance 1; return the cost, or infinity."""
    equations = PoseEquations(np.empty((6, 6)), np.empty(6))
    cost = normal_equations(parameters, points, pixels, weights, math.inf, q, t, equations)
    if not (cost < math.inf and factor_cholesky(equations.normal, 6, LEAST_PIVOT)):
        return math.inf
    invert_factored(equations.normal, covariance)
    return cost
