"""How well two views of paired dots are explained by one motion: the epipolar constraint, weighted in pixels.

With x_b = R x_a + t and y = R b_a, the constraint is e = b_b·(t × y) = 0. Its gradient is t × y with
respect to b_b and Rᵀ(b_b × t) with respect to b_a; divided by the standard deviation that pixel noise gives
it, e is Sampson's first-order distance.
"""

from __future__ import annotations

import math

import numpy as np

from omniservo.geometry.arrays import FloatArray, IntArray
from omniservo.geometry.kernel import kernel, leaf
from omniservo.perception.match_kernels import CAP, cross, dot, unit

STEPS = 25
LOG_DISTANCE, DEVIATION = 9, 10
"""the places of a dot's logarithm of the distance in radii, and of its standard deviation"""
BEHIND = 25.0
"""cost of a dot that the motion puts behind a camera"""


@leaf
def copy(source: FloatArray, target: FloatArray) -> None:
    """Copy a matrix (a slice assignment compiles many times as long)."""
    for r in range(source.shape[0]):
        for c in range(source.shape[1]):
            target[r, c] = source[r, c]


@leaf
def solve5(matrix: FloatArray, right: FloatArray) -> bool:
    """Solve a positive definite 5×5 system in place (Cholesky); the answer replaces ``right``."""
    for i in range(5):
        for j in range(i + 1):
            s = matrix[i, j]
            for k in range(j):
                s -= matrix[i, k] * matrix[j, k]
            if i == j:
                if s <= 0.0:
                    return False
                matrix[i, i] = math.sqrt(s)
            else:
                matrix[i, j] = s / matrix[j, j]
    for i in range(5):
        for k in range(i):
            right[i] -= matrix[i, k] * right[k]
        right[i] /= matrix[i, i]
    for i in range(4, -1, -1):
        for k in range(i + 1, 5):
            right[i] -= matrix[k, i] * right[k]
        right[i] /= matrix[i, i]
    return True


@kernel
def turn(rotation: FloatArray, w: FloatArray) -> None:
    """Replace R by exp([w]×)·R."""
    angle = math.sqrt(w[0] * w[0] + w[1] * w[1] + w[2] * w[2])
    s = math.sin(angle) / angle if angle > 1e-12 else 1.0
    c = (1.0 - math.cos(angle)) / (angle * angle) if angle > 1e-6 else 0.5
    column, once, twice = np.empty(3), np.empty(3), np.empty(3)
    for k in range(3):
        for r in range(3):
            column[r] = rotation[r, k]
        cross(w, column, once)
        cross(w, once, twice)
        for r in range(3):
            rotation[r, k] = column[r] + s * once[r] + c * twice[r]


@kernel
def linearise(
    side_a: FloatArray,
    side_b: FloatArray,
    pairs: IntArray,
    rotation: FloatArray,
    t: FloatArray,
    basis: FloatArray,
    normal: FloatArray,
    right: FloatArray,
) -> float:
    """Set the normal equations in (rotation vector, t along two directions); returns Σ e²/σ².

    ``side_a`` (n, 11), ``side_b`` (m, 11): see `score_hypotheses`.
    """
    for r in range(5):
        right[r] = 0.0
        for c in range(5):
            normal[r, c] = 0.0
    total = 0.0
    y, by_b, by_a, lever, row = np.empty(3), np.empty(3), np.empty(3), np.empty(3), np.empty(5)
    for i, j in pairs:
        a, b = side_a[i], side_b[j]
        for r in range(3):
            y[r] = rotation[r, 0] * a[0] + rotation[r, 1] * a[1] + rotation[r, 2] * a[2]
        cross(t, y, by_b)
        cross(b[:3], t, lever)
        e = b[0] * by_b[0] + b[1] * by_b[1] + b[2] * by_b[2]
        for r in range(3):
            by_a[r] = rotation[0, r] * lever[0] + rotation[1, r] * lever[1] + rotation[2, r] * lever[2]
        variance = 1e-30
        for c in range(2):
            sa = sb = 0.0
            for r in range(3):
                sa += a[3 + 2 * r + c] * by_a[r]
                sb += b[3 + 2 * r + c] * by_b[r]
            variance += sa * sa + sb * sb
        cross(y, lever, row[:3])
        cross(y, b[:3], by_a)
        for k in range(2):
            row[3 + k] = basis[k, 0] * by_a[0] + basis[k, 1] * by_a[1] + basis[k, 2] * by_a[2]
        for r in range(5):
            right[r] -= row[r] * e / variance
            for c in range(r + 1):
                normal[r, c] += row[r] * row[c] / variance
        total += e * e / variance
    return total


@kernel
def tangent_basis(t: FloatArray, basis: FloatArray) -> None:
    """Two unit vectors across the unit vector t."""
    axis = np.zeros(3)
    axis[0 if abs(t[0]) <= min(abs(t[1]), abs(t[2])) else 1 if abs(t[1]) <= abs(t[2]) else 2] = 1.0
    cross(t, axis, basis[0])
    unit(basis[0])
    cross(t, basis[0], basis[1])


@kernel
def fit_motion(
    side_a: FloatArray, side_b: FloatArray, pairs: IntArray, rotation: FloatArray, t: FloatArray
) -> float:
    """Levenberg–Marquardt from (R, t), both replaced; t is a unit vector. Returns Σ e²/σ² over the pairs."""
    basis, normal, damped = np.zeros((2, 3)), np.zeros((5, 5)), np.zeros((5, 5))
    right, step = np.zeros(5), np.zeros(5)
    trial_rotation, trial_t = np.empty((3, 3)), np.empty(3)
    unit(t)
    tangent_basis(t, basis)
    cost = linearise(side_a, side_b, pairs, rotation, t, basis, normal, right)
    damping = 1e-3
    for _ in range(STEPS):
        copy(normal, damped)
        for k in range(5):
            step[k] = right[k]
            damped[k, k] += damping * normal[k, k] + 1e-12
        if not solve5(damped, step):
            damping *= 10.0
            continue
        copy(rotation, trial_rotation)
        turn(trial_rotation, step[:3])
        for k in range(3):
            trial_t[k] = t[k] + step[3] * basis[0, k] + step[4] * basis[1, k]
        unit(trial_t)
        tangent_basis(trial_t, basis)
        trial = linearise(side_a, side_b, pairs, trial_rotation, trial_t, basis, damped, step)
        if trial < cost:
            gain = cost - trial
            copy(trial_rotation, rotation)
            copy(damped, normal)
            for k in range(5):
                right[k] = step[k]
            for k in range(3):
                t[k] = trial_t[k]
            cost = trial
            damping = max(damping * 0.1, 1e-9)
            if gain < 1e-4 * cost + 1e-9:
                break
        else:
            tangent_basis(t, basis)
            damping *= 10.0
            if damping > 1e6:
                break
    return cost


@kernel
def disagreement(
    side_a: FloatArray, side_b: FloatArray, pairs: IntArray, rotation: FloatArray, t: FloatArray
) -> float:
    """How badly (R, t) fits the sizes of the dots, and that all lie in front; t may change sign.

    With n = y × b_b the distances are λ_a = n·(b_b × t)/‖n‖², λ_b = n·(y × t)/‖n‖². For each dot two
    deviations of logarithms cost their square in variances, at most `CAP`: of λ_b/λ_a from the ratio of the
    size distances, whatever the dot's radius, and of √(λ_a λ_b) from theirs, up to one factor for all dots.
    A distance that is surely negative costs `BEHIND`.
    """
    count = len(pairs)
    offs, variances = np.empty(count), np.empty(count)
    total = weights = mean = 0.0
    behind = ahead = known = 0
    y, y_t, b_t, n = np.empty(3), np.empty(3), np.empty(3), np.empty(3)
    for i, j in pairs:
        a, b = side_a[i], side_b[j]
        for r in range(3):
            y[r] = rotation[r, 0] * a[0] + rotation[r, 1] * a[1] + rotation[r, 2] * a[2]
        cross(y, t, y_t)
        cross(b[:3], t, b_t)
        cross(y, b[:3], n)
        noise = 1e-18
        for k in range(3, LOG_DISTANCE):
            noise += 0.5 * (a[k] * a[k] + b[k] * b[k])
        sine_a, sine_b = dot(y_t, y_t) + 1e-12, dot(b_t, b_t) + 1e-12
        sizes = a[DEVIATION] * a[DEVIATION] + b[DEVIATION] * b[DEVIATION]
        off = 0.5 * math.log(sine_a / sine_b) - (b[LOG_DISTANCE] - a[LOG_DISTANCE])
        total += min(off * off / (sizes + noise / min(sine_a, sine_b)), CAP)
        parallax = dot(n, n)
        if parallax <= 25.0 * noise:
            continue
        first, second = dot(n, b_t), dot(n, y_t)
        if first * second <= 0.0:
            total += BEHIND
            continue
        if first > 0.0:
            ahead += 1
        else:
            behind += 1
        size = math.log(first * second) - a[LOG_DISTANCE] - b[LOG_DISTANCE]
        offs[known] = 0.5 * size - math.log(parallax)
        variances[known] = 0.25 * sizes + noise / parallax
        weights += 1.0 / variances[known]
        mean += offs[known] / variances[known]
        known += 1
    for k in range(known):
        off = offs[k] - mean / weights
        total += min(off * off / variances[k], CAP)
    if behind > ahead:
        for k in range(3):
            t[k] = -t[k]
        ahead, behind = behind, ahead
    return total + BEHIND * behind


@kernel
def score_hypotheses(
    side_a: FloatArray,
    side_b: FloatArray,
    pairs: IntArray,
    counts: IntArray,
    motions: FloatArray,
    costs: FloatArray,
) -> None:
    """Fit the motion of every hypothesis and say how well it explains the pairs.

    Args:
        side_a: (n, 11) of the first view: bearing; its 3×2 Jacobian by rows, times the noise [px];
            logarithm of the distance in radii, its standard deviation.
        side_b: (m, 11) of the second view.
        pairs: (h, k, 2) indices of paired dots.
        counts: (h,) how many of the k are used.
        motions: (h, 12) start R by rows, then t; receives the fitted ones, t of length 1.
        costs: (h, 2) receives Σ e²/σ² and the `disagreement`.
    """
    rotation, t = np.empty((3, 3)), np.empty(3)
    for h in range(len(costs)):
        used = pairs[h, : counts[h]]
        for r in range(3):
            t[r] = motions[h, 9 + r]
            for c in range(3):
                rotation[r, c] = motions[h, 3 * r + c]
        if dot(t, t) < 1e-18:
            t[2] = 1.0
        costs[h, 0] = fit_motion(side_a, side_b, used, rotation, t)
        costs[h, 1] = disagreement(side_a, side_b, used, rotation, t)
        for r in range(3):
            motions[h, 9 + r] = t[r]
            for c in range(3):
                motions[h, 3 * r + c] = rotation[r, c]
