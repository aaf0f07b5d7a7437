"""Which matches belong to a motion."""

import math

import numpy as np

from omniservo.cameras.unified_kernels import project_point
from omniservo.estimation.matches import Matches
from omniservo.estimation.minimal_solvers.essential_matrix import (
    motion_from_essential,
    ray_distances,
    turn_in_front,
)
from omniservo.estimation.refinement.epipolar_refinement import (
    essential_matrix,
    refine_epipolar,
    sampson_distances,
)
from omniservo.estimation.robust.consensus import gather
from omniservo.geometry.arrays import BoolArray, FloatArray
from omniservo.geometry.kernel import kernel, leaf
from omniservo.geometry.matrix_products import transposed_times

MOTION_PARAMETERS = 5
"""Rotation and direction; every match leaves one equation after its point is eliminated."""

SAMPLE_THRESHOLD_PX = 2.0
"""Sampson distance at which a match stops to count while sampling, where no noise is stated."""

GATE = 3.5
"""A match farther than this many σ from the epipolar geometry of the others is rejected."""

PRIOR_NOISE_PX = 0.5
PRIOR_WEIGHT = 4.0
"""While matches are chosen, σ is blended with this prior, worth so many matches: a handful of residuals
that happen to be small must not reject the rest."""

ROUNDS = 3
STEPS = 20


@kernel
def blended_noise(distances: FloatArray, members: BoolArray, stated: float) -> float:
    """Return σ [px]: what is stated, or from the median distance (so outliers do not enter) and the prior."""
    if stated > 0.0:
        return stated
    chosen = np.abs(distances[members])
    n = chosen.shape[0]
    if n == 0:
        return PRIOR_NOISE_PX
    robust = 1.4826 * float(np.median(chosen))
    square = PRIOR_WEIGHT * PRIOR_NOISE_PX**2 + robust * robust * n
    return math.sqrt(square / (PRIOR_WEIGHT + max(n - MOTION_PARAMETERS, 1)))


@leaf
def sampling_threshold(stated: float) -> float:
    """Return the Sampson distance [px] at which a match stops to count while sampling."""
    return GATE * stated if stated > 0.0 else SAMPLE_THRESHOLD_PX


@kernel
def farthest_match(matches: Matches, rotation: FloatArray, translation: FloatArray) -> tuple[float, float]:
    """Return the largest Sampson distance [px] of all matches to a motion, and their σ."""
    essential, distances = np.empty((3, 3)), np.empty(matches.pixels.shape[0])
    essential_matrix(rotation, translation, essential)
    sampson_distances(matches.bearings, matches.jacobians, essential, distances)
    everyone = np.ones(distances.shape[0], dtype=np.bool_)
    return float(np.abs(distances).max()), blended_noise(distances, everyone, matches.noise_px)


@kernel
def mark_members(
    matches: Matches, rotation: FloatArray, translation: FloatArray, gate: float, members: BoolArray
) -> tuple[int, float]:
    """Mark the matches within ``gate`` σ that can be points at all; return how many, and σ [px].

    σ is that of the ``members`` as they come.
    """
    n = members.shape[0]
    essential, distances = np.empty((3, 3)), np.empty(n)
    essential_matrix(rotation, translation, essential)
    sampson_distances(matches.bearings, matches.jacobians, essential, distances)
    sigma = blended_noise(distances, members, matches.noise_px)
    count = 0
    for j in range(n):
        members[j] = abs(distances[j]) <= gate * sigma and not meets_behind(matches, j, rotation, translation)
        count += members[j]
    return count, sigma


@leaf
def meets_behind(matches: Matches, j: int, rotation: FloatArray, translation: FloatArray) -> bool:
    """Tell whether match ``j``'s rays meet behind a camera, by more than a point at infinity with noise."""
    first, second = ray_distances(matches.bearings, j, rotation, translation)
    if 0.0 < first < math.inf and 0.0 < second < math.inf:
        return False
    b, p = matches.bearings, matches.pixels
    x, y, z = transposed_times(rotation, b[j, 0], b[j, 1], b[j, 2])
    u, v, ok = project_point(matches.parameters, x, y, z)
    reach = sampling_threshold(matches.noise_px / matches.weights[j, 1])
    return not (ok and math.hypot(u - p[j, 2], v - p[j, 3]) < reach)


@kernel
def members_of_consensus(matches: Matches, essential: FloatArray, members: BoolArray) -> int:
    """Mark the matches near the motion that a robust refinement makes of ``essential``; return how many."""
    n = members.shape[0]
    rotation, translation, distances = np.empty((3, 3)), np.empty(3), np.empty(n)
    near, slopes = np.empty_like(matches.bearings), np.empty_like(matches.jacobians)
    sampson_distances(matches.bearings, matches.jacobians, essential, distances)
    threshold = sampling_threshold(matches.noise_px)
    for j in range(n):
        members[j] = abs(distances[j]) < threshold
    if not motion_from_essential(essential, rotation, translation):
        return 0
    count = 0
    for _ in range(ROUNDS):
        sigma = blended_noise(distances, members, matches.noise_px)
        chosen = gather(matches.bearings, matches.jacobians, members, near, slopes)
        if chosen <= MOTION_PARAMETERS:
            return chosen
        refine_epipolar(near[:chosen], slopes[:chosen], 2.0 * sigma, rotation, translation, STEPS)
        turn_in_front(near[:chosen], rotation, translation)
        essential_matrix(rotation, translation, essential)
        sampson_distances(matches.bearings, matches.jacobians, essential, distances)
        before = members.copy()
        count, _ = mark_members(matches, rotation, translation, GATE, members)
        if np.array_equal(before, members):
            break
    return count
