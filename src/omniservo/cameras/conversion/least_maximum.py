"""From the smallest sum of squares to the smallest maximum, which is what a margin pays for."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from omniservo.geometry.arrays import FloatArray

_ROUNDS = 20
_GOOD_ENOUGH = 1e-6
_WORTH_WHILE = 1e-3
_STEP = 1e-6
_ROWS = 100
"""So many more of a linear program's rows are taken at a time."""
_EXACT = 1e-9


def least_maximum(differences: Callable[[FloatArray], FloatArray], vector: FloatArray) -> FloatArray:
    """Return a vector near ``vector`` whose largest ‖differences_i‖ is locally smallest.

    A sequence of linear programs (Madsen 1975): minimise t with |(r + J dx)·n| ≤ t along each residual
    r's own direction n and across it, inside a trust region that shrinks where a step breaks its promise.

    Args:
        differences: vector (k,) → (n, 2).
        vector: (k,), near a solution.
    """
    current = differences(vector)
    largest = float(np.hypot(*current.T).max())
    trust = 1.0
    jacobian = None
    for _ in range(_ROUNDS):
        if largest <= _GOOD_ENOUGH or trust < 1e-4:
            break
        if jacobian is None:
            jacobian = _jacobian(differences, vector, current)
        step, promised = _program(jacobian, current, trust)
        if promised > largest * (1.0 - _WORTH_WHILE):
            break
        tried = differences(vector + step)
        reached = float(np.hypot(*tried.T).max())
        if reached < largest:
            vector, current, largest, jacobian = vector + step, tried, reached, None
            trust *= 2.0
        else:
            trust *= 0.25
    return vector


def _jacobian(
    differences: Callable[[FloatArray], FloatArray], vector: FloatArray, current: FloatArray
) -> FloatArray:
    """Return the forward differences (n, 2, k)."""
    columns = []
    for i, x in enumerate(vector):
        moved = vector.copy()
        moved[i] += _STEP * max(1.0, abs(x))
        columns.append((differences(moved) - current) / (moved[i] - x))
    return np.stack(columns, axis=-1)


def _program(jacobian: FloatArray, current: FloatArray, trust: float) -> tuple[FloatArray, float]:
    """Return the step dx (k,) and the maximum that the linear model promises."""
    from scipy.optimize import linprog  # slow to import, and few cameras are converted

    lengths = np.maximum(np.hypot(*current.T), 1e-300)[:, None]
    along = current / lengths
    across = along[:, ::-1] * [-1.0, 1.0]
    normals = np.stack([along, across], axis=1)
    slopes = np.einsum("nij,njk->nik", normals, jacobian).reshape(-1, jacobian.shape[2])
    values = np.einsum("nij,nj->ni", normals, current).ravel()
    # columns in units of what moves the pixels by as much as the largest residual
    scale = float(lengths.max()) / np.maximum(np.abs(slopes).max(axis=0), 1e-12)
    scaled = slopes * scale
    rows, limits = np.vstack([scaled, -scaled]), np.concatenate([-values, values])
    count = int(scale.size)
    bounds = [(-10.0 * trust, 10.0 * trust)] * count + [(0.0, None)]
    chosen = np.argsort(limits)[:_ROWS]  # few decide: the others follow only where a step breaks them
    while True:
        A = np.hstack([rows[chosen], np.full((len(chosen), 1), -1.0)])
        result = linprog(np.append(np.zeros(count), 1.0), A, limits[chosen], bounds=bounds)
        if not result.success:
            return np.zeros(count), np.inf
        x = np.asarray(result.x)
        beyond = rows @ x[:-1] - limits - x[-1]
        beyond[chosen] = 0.0
        broken = np.argsort(-beyond)[:_ROWS]
        broken = broken[beyond[broken] > _EXACT * lengths.max()]
        if not len(broken):
            return x[:-1] * scale, float(x[-1])
        chosen = np.append(chosen, broken)
