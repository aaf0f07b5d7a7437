"""The camera's pose over time: what the images say of it, joined with the planned motion between them.

An extended Kalman filter on the pose. Its state estimate is a pose (7,) with the covariance (6, 6) of
(translation in the reference frame, rotation vector on the right), as everywhere. Between two images the
camera is carried along the motion of the joints, as measured, or else along the planned one; what that does
not know is the process noise. How well pixels are known is learnt from the residuals of several images: those
of one image of a few points say too little of it.
"""

import math

import numpy as np

from omniservo.estimation.refinement.pose_refinement import inverse_information
from omniservo.geometry.arrays import BoolArray, FloatArray
from omniservo.geometry.kernel import kernel, leaf
from omniservo.geometry.linear_systems import factor_cholesky, solve_factored
from omniservo.geometry.quaternions import matrix_from_quaternion, turn_quaternion

UNPLANNED_SPEED = 0.01
"""σ of the part of the velocity that is not known [m/s]: gain times some millimetres of error"""

UNPLANNED_TURN = 0.02
"""likewise of the angular velocity [rad/s]"""

UNKNOWN = 1e3
"""Variance of the first estimate [m²], [rad²]: the first image alone decides."""

LEAST_PIXEL_VARIANCE = 0.02**2
"""No pixel is known better [px²]: a few residuals that happen to vanish do not make a pose certain."""

MEMORY = 60.0
"""degrees of freedom: of so many residuals, the latest, is the pixels' variance"""


@leaf
def reset(covariance: FloatArray) -> None:
    """Make the covariance (6, 6) that of a pose of which nothing is known."""
    for i in range(6):
        for k in range(6):
            covariance[i, k] = UNKNOWN if i == k else 0.0


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
    """Join pose (7,) and covariance (6, 6) of the ``estimate`` with ``measured`` (7,) in the image, in place.

    K = P(P + C)⁻¹ with C the covariance of the measured pose: σ²(JᵀJ)⁻¹ of its reprojection error, and ssᵀ of
    its time stamp, s the camera's twist times the stamp's standard deviation. All points are off together
    then, by their flow times that of the stamp, J s: pixel noise with the covariance J ssᵀ Jᵀ. σ² is that of
    the residuals (2,), the estimate's third part, with this image's: Σr² [px²] and its degrees of freedom.
    """
    pose, covariance, residuals = estimate
    own, gain = np.empty((6, 6)), np.empty((6, 6))
    weights = used.astype(np.float64)
    cost = inverse_information(parameters, points, pixels, weights, measured[:4], measured[4:], own)
    if not cost < math.inf:
        return
    own *= _pixel_variance(residuals, cost, 2.0 * weights.sum() - 6.0)
    _add_stamp(measured, stamp, own)
    total = own + covariance
    if not factor_cholesky(total, 6, 1e-15):
        return
    column = np.empty(6)
    for i in range(6):  # row i of K = P S⁻¹ solves S kᵀ = pᵀ, both symmetric
        column[:] = covariance[i]
        solve_factored(total, 6, column)
        gain[i] = column
    gap, step, rest = np.empty(6), np.zeros(6), np.zeros((6, 6))
    _gap(pose, measured, gap)
    for i in range(6):
        for k in range(6):
            step[i] += gain[i, k] * gap[k]
            for m in range(6):
                rest[i, k] += gain[i, m] * own[m, k]
    for i in range(6):  # (I − K)P = K C
        for k in range(6):
            covariance[i, k] = 0.5 * (rest[i, k] + rest[k, i])
    pose[:4] = turn_quaternion(pose[:4], step[3], step[4], step[5])
    for i in range(3):
        pose[4 + i] += step[i]


@leaf
def _pixel_variance(residuals: FloatArray, cost: float, degrees: float) -> float:
    """Add an image's Σr² and its degrees of freedom to the ``residuals`` (2,); return σ² of all [px²]."""
    kept = min(1.0, max(MEMORY - degrees, 0.0) / max(residuals[1], 1.0))
    residuals[0] = kept * residuals[0] + cost
    residuals[1] = kept * residuals[1] + degrees
    return float(max(residuals[0] / residuals[1], LEAST_PIXEL_VARIANCE))


@kernel
def _add_stamp(measured: FloatArray, stamp: FloatArray, covariance: FloatArray) -> None:
    """Add to the covariance (6, 6) of a measured pose that of its time stamp, (6,) in the camera's frame."""
    r, off = np.empty((3, 3)), np.zeros(6)
    _matrix(measured, r)
    for i in range(3):
        off[3 + i] = stamp[3 + i]
        for k in range(3):
            off[i] += r[i, k] * stamp[k]
    for i in range(6):
        for k in range(6):
            covariance[i, k] += off[i] * off[k]


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
