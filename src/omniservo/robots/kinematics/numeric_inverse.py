"""Joints that bring the flange to a pose, found by descent: for arms without a closed form."""

from __future__ import annotations

import math

import numpy as np

from omniservo.geometry.arrays import FloatArray
from omniservo.geometry.held import held
from omniservo.geometry.kernel import kernel, leaf
from omniservo.geometry.vectors import copy_into
from omniservo.robots.kinematics.chain import Chain, least_motion, miss

STARTS = 64
"""Random configurations that a search begins at."""

_EXACT = 1e-10
"""norm of the twist at the goal, metres over a link's length beside radians"""
_SETTLED = 1e-14
_CRAWL = 0.999
"""a step that leaves more than this of the twist leads nowhere"""
_ITERATIONS = 60
_LEAST_DAMPING = 1e-12
"""Against ends of ranges fewer joints are left than the pose has degrees of freedom."""

_SAME = 1e-6
"""[rad] configurations closer than this are one"""


def solutions(chain: Chain, goal: FloatArray, starts: int = STARTS) -> FloatArray:
    """Return the configurations (k, n) [rad] that descents from the middle and from random ones reach.

    For six joints these are branches, all of them only in all likelihood; for seven, members of families.

    Args:
        chain: of n joints.
        goal: (4, 4) base_T_flange.
        starts: how many random ones, the same every time; 0: the middle alone.
    """
    low, high = chain.ranges.T
    random = np.random.default_rng(0).uniform(low, high, (starts, len(low)))
    return descend_all(chain, goal, np.concatenate([0.5 * (low + high)[None], random]))


@kernel
def descend_all(chain: Chain, goal: FloatArray, starts: FloatArray) -> FloatArray:
    """Return the different joints (k, n) within the ranges that `_descend` reaches from ``starts`` (m, n)."""
    held_chain = held(chain)
    found, count = np.empty(starts.shape), 0
    for i in range(starts.shape[0]):
        q = found[count]
        for j in range(starts.shape[1]):
            q[j] = starts[i, j]
        if _descend(held_chain, goal, q) and _is_new(found, count):
            count += 1
    return found[:count]


@leaf
def _is_new(found: FloatArray, count: int) -> bool:
    """Return whether row ``count`` is none of those before it."""
    for k in range(count):
        apart = 0.0
        for j in range(found.shape[1]):
            apart = max(apart, abs(found[count, j] - found[k, j]))
        if apart <= _SAME:
            return False
    return True


@kernel
def _descend(chain: Chain, goal: FloatArray, q: FloatArray) -> bool:
    """Lead the joints to the goal within their ranges; False: from there it is not reached.

    Levenberg–Marquardt with the smallest joint motion of all that serve (dq = Jᵀ(JJᵀ + μI)⁻¹ e); a joint at
    the end of its range that would leave it stands still.
    """
    n = q.shape[0]
    error, J, ahead = np.empty(6), np.empty((6, n)), np.empty(n)
    next_error, next_J, step = np.empty(6), np.empty((6, n)), np.zeros(n)
    size, damping = math.inf, 1e-3
    for _ in range(_ITERATIONS + 1):
        for j in range(n):
            ahead[j] = min(max(q[j] + step[j], chain.ranges[j, 0]), chain.ranges[j, 1])
        miss(chain, ahead, goal, next_error, next_J)
        next_size = _norm(next_error)
        if next_size < size:
            crawls = next_size > _CRAWL * size
            for j in range(n):
                q[j] = ahead[j]
            error, next_error, J, next_J, size = next_error, error, next_J, J, next_size
            damping = max(0.1 * damping, _LEAST_DAMPING)
            if crawls:
                break  # out of reach, or against the ends of the ranges
        elif size < _EXACT:
            break
        else:
            damping = 10.0 * max(damping, 1e-6)
        if size < _SETTLED or damping > 1e6:
            break
        if not _step(chain.ranges, error, J, damping, q, step):
            for j in range(n):
                step[j] = 0.0  # singular but for rounding: more damping
    return size < _EXACT


@kernel
def _step(
    ranges: FloatArray, error: FloatArray, J: FloatArray, damping: float, q: FloatArray, step: FloatArray
) -> bool:
    """Write the step (n,); joints that would leave their range are held, until none would."""
    free = np.empty(J.shape)
    copy_into(J, free)
    while True:
        if not least_motion(free, damping, error, step):
            return False
        blocked = False
        for j in range(q.shape[0]):
            if (q[j] <= ranges[j, 0] and step[j] < 0.0) or (q[j] >= ranges[j, 1] and step[j] > 0.0):
                for i in range(6):
                    free[i, j] = 0.0
                blocked = True
        if not blocked:
            return True


@leaf
def _norm(vector: FloatArray) -> float:
    total = 0.0
    for i in range(vector.shape[0]):
        total += vector[i] * vector[i]
    return math.sqrt(total)
