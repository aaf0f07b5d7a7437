"""Outliers: random samples of five matches, scored in px, with local optimisation (LO-RANSAC, MSAC score).

A match is scored by its Sampson distance in pixels.
Chum, Matas, Kittler 2003 (local optimisation); Torr, Zisserman 2000 (MSAC).
"""

import math

import numpy as np

from omniservo.estimation.minimal_solvers.essential_matrix import motion_from_essential
from omniservo.estimation.minimal_solvers.five_points import MOST_SOLUTIONS, SAMPLE, five_point_essentials
from omniservo.estimation.refinement.epipolar_refinement import (
    essential_matrix,
    refine_epipolar,
    sampson_distance,
)
from omniservo.geometry.arrays import BoolArray, FloatArray, IntArray
from omniservo.geometry.kernel import kernel, leaf

LEAST_SAMPLES = 20
MOST_SAMPLES = 2000
CONFIDENCE = 0.999
LOCAL_ROUNDS = 2
LOCAL_STEPS = 6
REACH = 2.0
"""The local optimisation looks at matches within so many thresholds."""


@kernel
def find_consensus(
    bearings: FloatArray, jacobians: FloatArray, threshold: float, seed: int, essential: FloatArray
) -> tuple[float, int]:
    """Write into ``essential`` (3, 3) the matrix with the least MSAC score; return (score, inliers).

    The score is Σ min(d², threshold²) [px²]. Sampling ends when a sample free of outliers has been drawn
    with probability :data:`CONFIDENCE`, or after :data:`MOST_SAMPLES`. The same seed gives the same answer.
    """
    n = bearings.shape[0]
    trials, chosen = np.empty((MOST_SOLUTIONS, 3, 3)), np.empty(SAMPLE, dtype=np.int64)
    near, slopes = np.empty_like(bearings), np.empty_like(jacobians)
    state = seed
    best, count, needed, drawn = math.inf, 0, MOST_SAMPLES, 0
    while drawn < needed:
        drawn += 1
        state = draw(state, n, chosen)
        better = -1
        for k in range(five_point_essentials(bearings, chosen, trials)):
            score, inliers = msac_score(bearings, jacobians, trials[k], threshold, best)
            if score < best:
                best, count, better = score, inliers, k
        if better < 0:
            continue
        _copy(trials[better], essential)
        for _ in range(LOCAL_ROUNDS):
            if not _improve(bearings, jacobians, essential, threshold, near, slopes, trials[0]):
                break
            score, inliers = msac_score(bearings, jacobians, trials[0], threshold, best)
            if not score < best:
                break
            best, count = score, inliers
            _copy(trials[0], essential)
        clean = (count / n) ** SAMPLE
        if clean > 1e-12:
            limit = math.log(1.0 - CONFIDENCE) / math.log(1.0 - min(clean, 1.0 - 1e-12))
            needed = min(MOST_SAMPLES, max(LEAST_SAMPLES, int(limit) + 1))
    return best, count


@leaf
def _copy(source: FloatArray, target: FloatArray) -> None:
    """Copy a 3×3 matrix."""
    for i in range(9):
        target[i // 3, i % 3] = source[i // 3, i % 3]


@leaf
def msac_score(
    bearings: FloatArray, jacobians: FloatArray, essential: FloatArray, threshold: float, best: float
) -> tuple[float, int]:
    """Return the MSAC score [px²] and the inliers; what cannot beat ``best`` any more is left early."""
    score, inliers, most = 0.0, 0, threshold * threshold
    for j in range(bearings.shape[0]):
        distance = sampson_distance(bearings, jacobians, j, essential)
        square = distance * distance
        if square < most:
            inliers += 1
            score += square
        else:
            score += most
        if score >= best:
            return math.inf, 0
    return score, inliers


@kernel
def _improve(
    bearings: FloatArray,
    jacobians: FloatArray,
    essential: FloatArray,
    threshold: float,
    near: FloatArray,
    slopes: FloatArray,
    improved: FloatArray,
) -> bool:
    """Write ``essential`` refined on the matches in reach, by robust loss; False where it has no motion."""
    rotation, translation = np.empty((3, 3)), np.empty(3)
    if not motion_from_essential(essential, rotation, translation):
        return False
    within = np.empty(bearings.shape[0], dtype=np.bool_)
    for j in range(bearings.shape[0]):
        distance = sampson_distance(bearings, jacobians, j, essential)
        within[j] = abs(distance) < REACH * threshold
    count = gather(bearings, jacobians, within, near, slopes)
    loss_scale = 0.5 * threshold
    refine_epipolar(near[:count], slopes[:count], loss_scale, rotation, translation, LOCAL_STEPS)
    essential_matrix(rotation, translation, improved)
    return True


@leaf
def gather(
    bearings: FloatArray, jacobians: FloatArray, chosen: BoolArray, near: FloatArray, slopes: FloatArray
) -> int:
    """Copy the chosen rows of both arrays to the front of ``near`` and ``slopes``; return how many."""
    count = 0
    for j in range(bearings.shape[0]):
        if chosen[j]:
            for i in range(6):
                near[count, i] = bearings[j, i]
            for i in range(12):
                slopes[count, i] = jacobians[j, i]
            count += 1
    return count


@leaf
def draw(state: int, n: int, chosen: IntArray) -> int:
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
