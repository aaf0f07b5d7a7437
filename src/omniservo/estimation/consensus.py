"""Outliers: random minimal samples of matches, scored in px, with local optimisation (LO-RANSAC, MSAC score).

A match is scored by its Sampson distance in pixels.
Chum, Matas, Kittler 2003 (local optimisation); Torr, Zisserman 2000 (MSAC).
"""

import math

import numpy as np

from omniservo.estimation.epipolar_refinement import essential_matrix, sampson_distances
from omniservo.estimation.essential_matrix import epipolar_gram, motions_from_essential
from omniservo.geometry.arrays import FloatArray, IntArray
from omniservo.geometry.kernel import kernel
from omniservo.geometry.linear_systems import symmetric_eigen

SAMPLE = 8
MOST_SAMPLES = 3000
CONFIDENCE = 0.999
LOCAL_ROUNDS = 3


@kernel
def find_consensus(
    bearings: FloatArray, jacobians: FloatArray, threshold: float, seed: int, essential: FloatArray
) -> tuple[float, int]:
    """Write into ``essential`` (3, 3) the matrix with the least MSAC score; return (score, inliers).

    The score is Σ min(d², threshold²) [px²]. Sampling ends when a sample free of outliers has been drawn
    with probability :data:`CONFIDENCE`, or after :data:`MOST_SAMPLES`. The same seed gives the same answer.
    """
    n = bearings.shape[0]
    distances, weights = np.empty(n), np.empty(n)
    trial = np.empty((3, 3))
    chosen = np.empty(SAMPLE, dtype=np.int64)
    state = seed
    best, count, needed, drawn = math.inf, 0, MOST_SAMPLES, 0
    while drawn < needed:
        drawn += 1
        state = _draw(state, n, chosen)
        if not _essential_of_sample(bearings, chosen, trial):
            continue
        score, inliers = _score(bearings, jacobians, trial, threshold, distances, weights)
        if not score < best:
            continue
        best, count = score, inliers
        _copy(trial, essential)
        for _ in range(LOCAL_ROUNDS):
            if not _improve(bearings, threshold, distances, weights, trial):
                break
            score, inliers = _score(bearings, jacobians, trial, threshold, distances, weights)
            if not score < best:
                break
            best, count = score, inliers
            _copy(trial, essential)
        clean = (count / n) ** SAMPLE
        if clean > 1e-12:
            limit = math.log(1.0 - CONFIDENCE) / math.log(1.0 - min(clean, 1.0 - 1e-12))
            needed = min(MOST_SAMPLES, int(limit) + 1)
    return best, count


@kernel
def _copy(source: FloatArray, target: FloatArray) -> None:
    """Copy a 3×3 matrix."""
    for i in range(9):
        target[i // 3, i % 3] = source[i // 3, i % 3]


@kernel
def _score(
    bearings: FloatArray,
    jacobians: FloatArray,
    essential: FloatArray,
    threshold: float,
    distances: FloatArray,
    weights: FloatArray,
) -> tuple[float, int]:
    """Return the MSAC score [px²] and the number of matches within the threshold."""
    sampson_distances(bearings, jacobians, essential, distances, weights)
    score, inliers = 0.0, 0
    for j in range(distances.shape[0]):
        if abs(distances[j]) < threshold:
            inliers += 1
        score += min(distances[j] * distances[j], threshold * threshold)
    return score, inliers


@kernel
def _improve(
    bearings: FloatArray, threshold: float, distances: FloatArray, weights: FloatArray, essential: FloatArray
) -> bool:
    """Replace ``essential`` by the eight-point solution, in px weights, of the matches in reach."""
    inliers = 0
    for j in range(distances.shape[0]):
        if abs(distances[j]) < threshold:
            inliers += 1
        else:
            weights[j] = 0.0
    if inliers < SAMPLE:
        return False
    gram = np.empty((9, 9))
    epipolar_gram(bearings, weights, gram)
    _, vectors = symmetric_eigen(gram)
    null = np.empty(9)
    for i in range(9):
        null[i] = vectors[i, 0]
    return _nearest_essential(null, essential)


@kernel
def _nearest_essential(entries: FloatArray, essential: FloatArray) -> bool:
    """Write the essential matrix nearest to nine entries: equal singular values, [t]× R."""
    rotations, t = np.empty((2, 3, 3)), np.empty(3)
    for i in range(9):
        essential[i // 3, i % 3] = entries[i]
    if not motions_from_essential(essential, rotations, t):
        return False
    essential_matrix(rotations[0], t, essential)
    return True


@kernel
def _draw(state: int, n: int, chosen: IntArray) -> int:
    """Fill ``chosen`` with distinct numbers below n; return the next state (48-bit linear congruence)."""
    for i in range(chosen.shape[0]):
        fresh = False
        while not fresh:
            state = (state * 25214903917 + 11) & ((1 << 48) - 1)
            chosen[i] = (state >> 17) % n
            fresh = True
            for k in range(i):
                if chosen[k] == chosen[i]:
                    fresh = False
    return state


@kernel
def _essential_of_sample(bearings: FloatArray, chosen: IntArray, essential: FloatArray) -> bool:
    """Write the essential matrix nearest to the null vector of eight matches; False where it is not unique.

    Gaussian elimination with full pivoting on the 8×9 matrix.
    """
    a = np.empty((SAMPLE, 9))
    order = np.arange(9)
    for i in range(SAMPLE):
        for p in range(3):
            for q in range(3):
                a[i, 3 * p + q] = bearings[chosen[i], p] * bearings[chosen[i], 3 + q]
    for step in range(SAMPLE):
        row, column, largest = step, step, 0.0
        for i in range(step, SAMPLE):
            for k in range(step, 9):
                if abs(a[i, k]) > largest:
                    row, column, largest = i, k, abs(a[i, k])
        if largest < 1e-12:
            return False
        order[step], order[column] = order[column], order[step]
        for i in range(SAMPLE):
            a[i, step], a[i, column] = a[i, column], a[i, step]
        for k in range(9):
            a[step, k], a[row, k] = a[row, k], a[step, k]
        for i in range(step + 1, SAMPLE):
            factor = a[i, step] / a[step, step]
            for k in range(step, 9):
                a[i, k] -= factor * a[step, k]
    null = np.empty(9)
    null[order[8]] = 1.0
    for i in range(SAMPLE - 1, -1, -1):
        entry = -a[i, 8]
        for k in range(i + 1, SAMPLE):
            entry -= a[i, k] * null[order[k]]
        null[order[i]] = entry / a[i, i]
    return _nearest_essential(null, essential)
