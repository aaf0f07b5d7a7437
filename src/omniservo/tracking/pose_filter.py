"""The camera's pose over time: what the images say of it, joined with the planned motion between them.

An extended Kalman filter on the pose. Its state estimate is a pose (7,) with the covariance (6, 6) of
(translation in the reference frame, rotation vector on the right), as everywhere. Between two images the
camera is carried along the motion of the joints, as measured, or else along the planned one; what that does
not know is the process noise. How well pixels are known is learnt from the residuals of several images: those
of one image of a few points say too little of it.
"""

import math

import numpy as np
from scipy.special import chdtri, fdtri

from omniservo.estimation.refinement.pose_refinement import PoseEquations, normal_equations, pose_cost
from omniservo.geometry.arrays import BoolArray, FloatArray
from omniservo.geometry.kernel import kernel, leaf
from omniservo.geometry.linear_systems import factor_cholesky, invert_factored, solve_factored
from omniservo.geometry.quaternions import matrix_from_quaternion, turn_quaternion

UNPLANNED_SPEED = 0.01
"""σ of the part of the velocity that is not known [m/s]: gain times some millimetres of error"""

UNPLANNED_TURN = 0.02
"""likewise of the angular velocity [rad/s]"""

START_TURN = 0.05
"""σ of the orientation before the first image [rad]: a plan is followed from where it begins. An image of few
points close together leaves two orientations, often more than 10° apart, and may favour the wrong one."""

UNKNOWN = 1e3
"""Variance of the position before the first image [m²], which alone decides it"""

LEAST_PIXEL_SIGMA = 0.02
"""No pixel is known better [px],"""

FEW_RESIDUALS_SIGMA = 0.6
"""nor better than this over the residuals' degrees of freedom [px]: the two of one image of four points are
a tenth of what they should be once in ten times."""

MEMORY = 60.0
"""degrees of freedom: of so many residuals, the latest, is the pixels' variance"""

WIDER = np.array(
    [
        6.0 * float(fdtri(6, max(degrees, 2), 0.95)) / float(chdtri(6, 0.05))
        for degrees in range(int(MEMORY) + 1)
    ]
)
"""(61,) by the residuals' degrees of freedom, at least 2: so much larger a variance makes the 95% ellipsoid
of six numbers that of Fisher's F, for a mean of so few squares"""

MOST_STEPS = 8
"""of Gauss and Newton"""

ENOUGH = 1e-8
"""A step that gains less than this is the last; the unit is one σ²"""

LEAST_PIVOT = 1e-15


def covariance_at_start() -> FloatArray:
    """Return the covariance (6, 6) of a camera that stands where a plan begins, before its first image."""
    return np.diag(np.repeat((UNKNOWN, START_TURN**2), 3))


@kernel
def predict_state(
    pose: FloatArray, covariance: FloatArray, plan_before: FloatArray, plan_after: FloatArray, seconds: float
) -> None:
    """Carry pose (7,) and covariance (6, 6) along the motion Δ = plan_before⁻¹ plan_after, in place.

    T ← T Δ: t' = t + R d, R' = R Δ_R, so δt' = δt − R[d]× δ and δ' = Δ_Rᵀ δ; then the process noise of
    ``seconds``.
    """
    r, before, after = np.empty((3, 3)), np.empty((3, 3)), np.empty((3, 3))
    _matrix(pose, r)
    _matrix(plan_before, before)
    _matrix(plan_after, after)
    turn, d = np.zeros((3, 3)), np.zeros(3)
    for i in range(3):
        for k in range(3):
            d[i] += before[k, i] * (plan_after[4 + k] - plan_before[4 + k])
            for m in range(3):
                turn[i, k] += before[m, i] * after[m, k]
    transition = np.zeros((6, 6))
    for i in range(3):
        transition[i, i] = 1.0
        transition[i, 3] = -(r[i, 1] * d[2] - r[i, 2] * d[1])
        transition[i, 4] = -(r[i, 2] * d[0] - r[i, 0] * d[2])
        transition[i, 5] = -(r[i, 0] * d[1] - r[i, 1] * d[0])
        for k in range(3):
            pose[4 + i] += r[i, k] * d[k]
            transition[3 + i, 3 + k] = turn[k, i]
    _compose(pose, plan_before, plan_after)
    _congruence(transition, covariance)
    for i in range(3):
        covariance[i, i] += (UNPLANNED_SPEED * seconds) ** 2
        covariance[3 + i, 3 + i] += (UNPLANNED_TURN * seconds) ** 2


@kernel
def correct_state(
    parameters: FloatArray,
    points: FloatArray,
    pixels: FloatArray,
    used: BoolArray,
    measured: FloatArray,
    stamp: FloatArray,
    estimate: tuple[FloatArray, FloatArray, FloatArray],
) -> None:
    """Join pose (7,) and covariance (6, 6) of the ``estimate`` with an image, in place.

    The pose is that of least gᵀP⁻¹g + rᵀWr, found by Gauss-Newton steps from the predicted pose or from
    ``measured`` (7,), the pose of this image alone, whichever is lower: g leads to the prediction, r are the
    reprojection errors, W⁻¹ = σ² + (Js)(Js)ᵀ with s the camera's twist times the standard deviation of the
    time stamp, by which all points are off together. Its covariance is (P⁻¹ + JᵀWJ)⁻¹ there: to join the
    poses of single images instead would count those most that happen to seem certain. σ² is that of the
    residuals (2,), the estimate's third part, with this image's: Σr² [px²] and its degrees of freedom.
    """
    pose, covariance, residuals = estimate
    weights, information = used.astype(np.float64), np.empty((6, 6))
    cost = pose_cost(parameters, points, pixels, weights, math.inf, measured[:4], measured[4:])
    if not (cost < math.inf and _invert(covariance, information)):
        return
    variance = _pixel_variance(residuals, cost, 2.0 * weights.sum() - 6.0)
    seen, prior, noise = (parameters, points, pixels, weights), (pose.copy(), information), (variance, stamp)
    here, there = (
        PoseEquations(np.empty((6, 6)), np.empty(6)),
        PoseEquations(np.empty((6, 6)), np.empty(6)),
    )
    best, value = pose.copy(), _write_equations(seen, prior, noise, pose, here)
    trial, found = measured.copy(), _write_equations(seen, prior, noise, measured, there)
    decrement, factor, step = math.inf, np.empty((6, 6)), np.empty(6)
    for _ in range(MOST_STEPS):
        if found <= value:
            best[:], value = trial, found
            here.normal[:], here.gradient[:] = there.normal, there.gradient
        elif decrement < math.inf:
            break
        factor[:], step[:] = here.normal, -here.gradient
        if decrement < ENOUGH or not (value < math.inf and factor_cholesky(factor, 6, LEAST_PIVOT)):
            break
        solve_factored(factor, 6, step)
        decrement = -(here.gradient * step).sum()
        trial[:4] = turn_quaternion(best[:4], step[3], step[4], step[5])
        trial[4:] = best[4:] + step[:3]
        found = _write_equations(seen, prior, noise, trial, there)
    if value < math.inf and _invert(here.normal, covariance):
        pose[:] = best


@kernel
def _write_equations(
    seen: tuple[FloatArray, FloatArray, FloatArray, FloatArray],
    prior: tuple[FloatArray, FloatArray],
    noise: tuple[float, FloatArray],
    pose: FloatArray,
    equations: PoseEquations,
) -> float:
    """Fill the normal equations of image and prediction at ``pose`` (7,) and return what they minimise.

    With N = JᵀJ/σ² and d = Jᵀr/σ²: JᵀWJ = N − NssᵀN/(1 + sᵀNs), and likewise d and r.

    Args:
        seen: the camera's parameters, points, pixels and weights.
        prior: the predicted pose (7,), and its P⁻¹ (6, 6).
        noise: σ² of the pixels [px²], and s (6,) in the camera's frame.
        pose: where.
        equations: out.
    """
    parameters, points, pixels, weights = seen
    (predicted, information), (variance, stamp) = prior, noise
    value = normal_equations(parameters, points, pixels, weights, math.inf, pose[:4], pose[4:], equations)
    if not value < math.inf:
        return math.inf
    normal, gradient = equations.normal, equations.gradient
    value, along, total = value / variance, 0.0, 1.0
    normal /= variance
    gradient /= variance
    r, off, pulled, gap = np.empty((3, 3)), np.zeros(6), np.zeros(6), np.empty(6)
    _matrix(pose, r)
    for i in range(3):
        off[3 + i] = stamp[3 + i]
        for k in range(3):
            off[i] += r[i, k] * stamp[k]
    for i in range(6):
        for k in range(6):
            pulled[i] += normal[i, k] * off[k]
    for i in range(6):
        along += gradient[i] * off[i]
        total += pulled[i] * off[i]
    value -= along * along / total
    _gap(pose, predicted, gap)
    for i in range(6):
        gradient[i] -= pulled[i] * along / total
        for k in range(6):
            normal[i, k] += information[i, k] - pulled[i] * pulled[k] / total
            gradient[i] -= information[i, k] * gap[k]
            value += gap[i] * information[i, k] * gap[k]
    return value


@leaf
def _pixel_variance(residuals: FloatArray, cost: float, degrees: float) -> float:
    """Add an image's Σr² and its degrees of freedom to the ``residuals`` (2,); return σ² of all [px²].

    It is as much larger than their mean as so few may be too small by: see `WIDER`.
    """
    kept = min(1.0, max(MEMORY - degrees, 0.0) / max(residuals[1], 1.0))
    residuals[0] = kept * residuals[0] + cost
    residuals[1] = kept * residuals[1] + degrees
    wider = WIDER[min(int(residuals[1]), len(WIDER) - 1)]
    least = max(LEAST_PIXEL_SIGMA, FEW_RESIDUALS_SIGMA / residuals[1])
    return float(max(wider * residuals[0] / residuals[1], least * least))


@kernel
def _invert(matrix: FloatArray, inverse: FloatArray) -> bool:
    """Write the inverse of a symmetric matrix (6, 6); False, with nothing written, where it is singular."""
    factor = matrix.copy()
    if not factor_cholesky(factor, 6, LEAST_PIVOT):
        return False
    invert_factored(factor, inverse)
    for i in range(6):
        for k in range(i):
            inverse[i, k] = inverse[k, i] = 0.5 * (inverse[i, k] + inverse[k, i])
    return True


@leaf
def _gap(pose: FloatArray, other: FloatArray, gap: FloatArray) -> None:
    """Write what leads from ``pose`` to ``other``: translation and rotation vector on the right, (6,)."""
    x, y, z, w = pose[0], pose[1], pose[2], pose[3]
    a, b, c, d = other[0], other[1], other[2], other[3]
    vx = w * a - x * d - (y * c - z * b)
    vy = w * b - y * d - (z * a - x * c)
    vz = w * c - z * d - (x * b - y * a)
    scalar = w * d + x * a + y * b + z * c
    sine = math.sqrt(vx * vx + vy * vy + vz * vz)
    if scalar < 0.0:
        vx, vy, vz, scalar = -vx, -vy, -vz, -scalar
    factor = 2.0 * math.atan2(sine, scalar) / sine if sine > 1e-12 else 2.0
    gap[3], gap[4], gap[5] = factor * vx, factor * vy, factor * vz
    for i in range(3):
        gap[i] = other[4 + i] - pose[4 + i]


@leaf
def _compose(pose: FloatArray, before: FloatArray, after: FloatArray) -> None:
    """Turn ``pose`` by the planned rotation: q ← q · before* · after, of length 1."""
    _multiply(pose, -before[0], -before[1], -before[2], before[3])
    _multiply(pose, after[0], after[1], after[2], after[3])
    norm = math.sqrt(pose[0] ** 2 + pose[1] ** 2 + pose[2] ** 2 + pose[3] ** 2)
    for i in range(4):
        pose[i] /= norm


@leaf
def _multiply(q: FloatArray, a: float, b: float, c: float, d: float) -> None:
    """Multiply the quaternion in q[:4] by (a, b, c, d) from the right."""
    x, y, z, w = q[0], q[1], q[2], q[3]
    q[0] = w * a + x * d + y * c - z * b
    q[1] = w * b + y * d + z * a - x * c
    q[2] = w * c + z * d + x * b - y * a
    q[3] = w * d - x * a - y * b - z * c


@leaf
def _matrix(pose: FloatArray, r: FloatArray) -> None:
    """Write the rotation matrix (3, 3) of a pose."""
    matrix_from_quaternion(pose[0], pose[1], pose[2], pose[3], r)


@kernel
def _congruence(transition: FloatArray, covariance: FloatArray) -> None:
    """Replace P by F P Fᵀ, all (6, 6)."""
    half = np.zeros((6, 6))
    for i in range(6):
        for k in range(6):
            for m in range(6):
                half[i, k] += transition[i, m] * covariance[m, k]
    for i in range(6):
        for k in range(6):
            total = 0.0
            for m in range(6):
                total += half[i, m] * transition[k, m]
            covariance[i, k] = total
