"""Joints that bring the tool to a pose, found by descent: for arms without a closed form."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from typing import TypeAlias

import numpy as np

from omniservo.geometry.arrays import FloatArray

Miss: TypeAlias = Callable[[FloatArray], tuple[FloatArray, FloatArray]]
"""Of joints (n,) [rad]: the twist (6,) that leads to the goal, and its Jacobian J (6, n): twist = J dq."""

STARTS = 64
"""Random postures that a search begins at."""

_EXACT = 1e-10
"""norm of the twist at the goal, metres over a link's length beside radians"""
_SETTLED = 1e-14
_CRAWL = 0.999
"""a step that leaves more than this of the twist leads nowhere"""
_ITERATIONS = 60
_LEAST_DAMPING = 1e-12
"""Against ends of ranges fewer joints are left than the pose has degrees of freedom."""

_SAME = 1e-6
"""[rad] postures closer than this are one"""


def descend(miss: Miss, start: FloatArray, joint_range: FloatArray) -> FloatArray | None:
    """Return joints (n,) at the goal, reached from ``start`` within the ranges (n, 2); None: not from there.

    Levenberg–Marquardt with the smallest joint motion of all that serve (dq = Jᵀ(JJᵀ + μI)⁻¹ e); a joint at
    the end of its range that would leave it stands still.
    """
    low, high = joint_range.T
    q = np.clip(start, low, high)
    error, jacobian = miss(q)
    size, damping = float(np.linalg.norm(error)), 1e-4
    for _ in range(_ITERATIONS):
        if size < _SETTLED or damping > 1e6:
            break
        ahead = np.clip(q + _step(error, jacobian, damping, q, joint_range), low, high)
        next_error, next_jacobian = miss(ahead)
        next_size = float(np.linalg.norm(next_error))
        if next_size < size:
            crawls = next_size > _CRAWL * size
            q, error, jacobian, size = ahead, next_error, next_jacobian, next_size
            damping = max(0.1 * damping, _LEAST_DAMPING)
            if crawls:
                break  # out of reach, or against the ends of the ranges
        elif size < _EXACT:
            break
        else:
            damping = 10.0 * max(damping, 1e-6)
    return q if size < _EXACT else None


def solutions(miss: Miss, joint_range: FloatArray) -> FloatArray:
    """Return the postures (k, n) [rad] that descents from the middle and from `STARTS` random ones reach.

    For six joints these are branches, all of them only in all likelihood; for seven, members of families.
    """
    found: list[FloatArray] = []
    for start in _starts(joint_range):
        q = descend(miss, start, joint_range)
        if q is not None and all(np.abs(q - other).max() > _SAME for other in found):
            found.append(q)
    return np.array(found).reshape(-1, len(joint_range))


def _starts(joint_range: FloatArray) -> Iterator[FloatArray]:
    yield joint_range.mean(axis=1)
    random = np.random.default_rng(0)
    for _ in range(STARTS):
        yield random.uniform(joint_range[:, 0], joint_range[:, 1])


def _step(
    error: FloatArray, jacobian: FloatArray, damping: float, q: FloatArray, joint_range: FloatArray
) -> FloatArray:
    free = np.ones(len(q), dtype=bool)
    while True:
        moved = jacobian * free
        step: FloatArray = moved.T @ np.linalg.solve(moved @ moved.T + damping * np.eye(6), error)
        leaving = free & (((q <= joint_range[:, 0]) & (step < 0)) | ((q >= joint_range[:, 1]) & (step > 0)))
        if not leaving.any():
            return step
        free &= ~leaving
