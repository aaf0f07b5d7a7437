"""Small strictly convex quadratic programs: min ½ dᵀHd + cᵀd subject to A d ≥ b, by the dual's active set."""

import math

import numpy as np

from omniservo.geometry.arrays import BoolArray, FloatArray, IntArray
from omniservo.geometry.kernel import kernel, leaf
from omniservo.geometry.linear_systems import factor_cholesky, solve_factored

GIVE = 1e-11
"""A row may be missed by this part of its multiplier: contradicting rows then share what they miss."""

NEAR_ZERO = 1e-9
"""A row that is missed by less, relative to the largest number involved, holds."""


@kernel
def nonnegative_minimum(gram: FloatArray, right: FloatArray, multipliers: FloatArray) -> None:
    """Write the λ ≥ 0 (m,) with the least ½ λᵀGλ − hᵀλ; G (m, m) positive definite (Lawson–Hanson).

    The row that is missed most becomes active; where that turns a multiplier negative, the step ends there
    and its row is left out again.
    """
    m = gram.shape[0]
    active, order = np.zeros(m, dtype=np.bool_), np.empty(m, dtype=np.int64)
    factor, solution = np.empty((m, m)), np.empty(m)
    largest = 0.0
    for i in range(m):
        multipliers[i] = 0.0
        largest = max(largest, abs(right[i]))
    for _ in range(10 * m):
        worst, most = -1, NEAR_ZERO * largest
        for i in range(m):
            missed = right[i]
            for k in range(m):
                if active[k]:
                    missed -= gram[i, k] * multipliers[k]
            if missed > most and not active[i]:
                worst, most = i, missed
        if worst < 0:
            return
        active[worst] = True
        while True:
            count = _solve_active(gram, right, active, order, factor, solution)
            if count == 0:
                return
            part, leaving = 1.0, -1
            for a in range(count):
                i = order[a]
                if solution[a] <= 0.0:
                    reach = multipliers[i] / (multipliers[i] - solution[a]) if multipliers[i] > 0.0 else 0.0
                    if reach < part or leaving < 0:
                        part, leaving = reach, i
            for a in range(count):
                i = order[a]
                multipliers[i] = max(0.0, multipliers[i] + part * (solution[a] - multipliers[i]))
            if leaving < 0:
                break
            multipliers[leaving] = 0.0
            active[leaving] = False
            if leaving == worst:
                return


@leaf
def _solve_active(
    gram: FloatArray,
    right: FloatArray,
    active: BoolArray,
    order: IntArray,
    factor: FloatArray,
    solution: FloatArray,
) -> int:
    """Solve G λ = h on the active rows alone; return how many they are, 0 where G is singular there."""
    count = 0
    for i in range(active.shape[0]):
        if active[i]:
            order[count] = i
            count += 1
    for a in range(count):
        solution[a] = right[order[a]]
        for b in range(a + 1):
            factor[a, b] = gram[order[a], order[b]]
    if not factor_cholesky(factor, count, 0.0):
        return 0
    solve_factored(factor, count, solution)
    return count


@kernel
def quadratic_step(
    hessian: FloatArray,
    gradient: FloatArray,
    rows: FloatArray,
    right: FloatArray,
    step: FloatArray,
    multipliers: FloatArray,
) -> bool:
    """Write d (n,) of least ½ dᵀHd + cᵀd with A d ≥ b, and the multipliers λ ≥ 0 (m,), H d + c = Aᵀλ.

    Args:
        hessian: H (n, n), positive definite; False is returned where it is not.
        gradient: c (n,).
        rows: A (m, n).
        right: b (m,).
        step: d is written here.
        multipliers: λ is written here.
    """
    m, n = rows.shape
    factor = hessian.copy()
    if not factor_cholesky(factor, n, 1e-15):
        return False
    inward, gram, missing = np.empty((m, n)), np.empty((m, m)), np.empty(m)
    for i in range(n):
        step[i] = -gradient[i]
    solve_factored(factor, n, step)
    for i in range(m):
        missing[i] = right[i]
        for k in range(n):
            missing[i] -= rows[i, k] * step[k]
        for k in range(n):
            total = rows[i, k]
            for q in range(k):
                total -= factor[k, q] * inward[i, q]
            inward[i, k] = total / factor[k, k]
        for j in range(i + 1):
            total = 0.0
            for k in range(n):
                total += inward[i, k] * inward[j, k]
            gram[i, j] = gram[j, i] = total
    largest = 0.0
    for i in range(m):
        largest = max(largest, gram[i, i])
    for i in range(m):
        gram[i, i] += GIVE * largest + 1e-300
    nonnegative_minimum(gram, missing, multipliers)
    push = np.zeros(n)
    for i in range(m):
        for k in range(n):
            push[k] += multipliers[i] * rows[i, k]
    solve_factored(factor, n, push)
    finite = True
    for k in range(n):
        step[k] += push[k]
        finite = finite and math.isfinite(step[k])
    return finite
