"""The rotation or homography that most matches obey, wrong ones among them.

A homography of bearings needs four matches, and they must agree on which side of the camera all is: most
wrong samples are left at once.
"""

import math

import numpy as np

from omniservo.estimation.matches import Matches
from omniservo.estimation.robust.consensus import draw
from omniservo.estimation.status.degenerate_motion import (
    HOMOGRAPHY,
    IDENTITY,
    ROTATION,
    algebraic_map,
    map_distance,
    map_distances,
    refine_linear_map,
)
from omniservo.geometry.arrays import BoolArray, FloatArray, IntArray
from omniservo.geometry.kernel import kernel, leaf

SAMPLE = 4
GOLDEN = 0.5 * (math.sqrt(5.0) - 1.0)
ROBUST_STEPS = 6
CONFIDENCE = 0.999

BULK = 0.65
"""A map counts where so many of the members obey it."""
BULK_SAMPLES = 18
"""One of so many holds, with 97%, only members that obey where no more than `BULK` do."""
HEAD_START = 4
"""A sample's map is left that so many more members disobey than halfway between the least share that may and
all: one that the least share obeys gets there with 0.1%."""


@kernel
def bulk_maps(matches: Matches, members: BoolArray, gate: float) -> FloatArray:
    """Return the distances (3, n) [px] of all matches to identity, rotation and homography of the members.

    Those to a map that fewer than `BULK` of the members obey within ``gate`` are infinite.
    """
    n, inside = members.shape[0], int(members.sum())
    least, found, distances = BULK * inside, np.full((3, n), math.inf), np.empty(n)
    for kind in (HOMOGRAPHY, ROTATION, IDENTITY):
        if kind == ROTATION and not _keeps_angles(matches, members, gate):
            continue
        if kind == IDENTITY and math.isinf(found[ROTATION].min()):
            continue  # the identity is a rotation
        robust_map(matches, kind, members, gate, least, BULK_SAMPLES, distances)
        obey = 0
        for j in range(n):
            obey += members[j] and distances[j] < gate
        if obey >= least:
            found[kind] = distances
    return found


@kernel
def _keeps_angles(matches: Matches, members: BoolArray, gate: float) -> bool:
    """Tell whether a rotation may hold: it keeps the angle between bearings, of both in enough pairs.

    Two members each within ``gate`` [px] of a rotation see their angle change by at most 2 gate (J + J'), J
    and J' the larger of either's angles by pixel. A member that disobeys spoils one pair.
    """
    places = np.flatnonzero(members)
    half = places.shape[0] // 2
    bearings, kept = matches.bearings, 0
    for k in range(half):
        i, j = places[k], places[k + half]
        most = 2.0 * gate * (_angle_by_pixel(matches.jacobians[i]) + _angle_by_pixel(matches.jacobians[j]))
        initial = _angle(bearings[i, :3], bearings[j, :3])
        kept += abs(initial - _angle(bearings[i, 3:], bearings[j, 3:])) < most
    return kept >= half - (1.0 - BULK) * places.shape[0]


@leaf
def _angle(a: FloatArray, b: FloatArray) -> float:
    """Return the angle of two unit vectors [rad]."""
    chord = 0.0
    for i in range(3):
        chord += (a[i] - b[i]) ** 2
    return 2.0 * math.asin(min(1.0, 0.5 * math.sqrt(chord)))


@leaf
def _angle_by_pixel(jacobian: FloatArray) -> float:
    """Return the larger of the two images' Frobenius norms of ∂b/∂p [rad/px]."""
    initial, goal = 0.0, 0.0
    for i in range(6):
        initial += jacobian[i] ** 2
        goal += jacobian[6 + i] ** 2
    return math.sqrt(max(initial, goal))


@kernel
def robust_map(
    matches: Matches,
    kind: int,
    members: BoolArray,
    gate: float,
    least: float,
    most_samples: int,
    distances: FloatArray,
) -> FloatArray:
    """Return the map (3, 3) that most of the members obey.

    A homography starts from the best sample of four members, a rotation from the algebraic solution; then a
    Cauchy loss whose scale follows the median distance down to half of ``gate`` [px]. ``distances`` (n,) are
    those of all matches to it, all infinite where no sample led to ``least`` of the members.
    """
    if kind == HOMOGRAPHY:
        matrix = np.eye(3)
        distances[:] = math.inf
        if not _sampled_homography(matches, members, gate, least, most_samples, matrix):
            return matrix
    else:
        matrix = algebraic_map(matches.bearings, members, kind)
    map_distances(matches, matrix, distances)
    before = math.inf
    for _ in range(ROBUST_STEPS if kind != IDENTITY else 0):
        middle = float(np.median(distances[members]))
        if not middle < math.inf or (middle > gate and middle > 0.5 * before):
            break  # no bulk that pulls the map to itself
        before = middle
        refine_linear_map(matches, kind, max(0.5 * gate, middle), math.inf, 1, matrix)
        map_distances(matches, matrix, distances)
        if middle < 0.5 * gate:
            break
    return matrix


@kernel
def _sampled_homography(
    matches: Matches, members: BoolArray, gate: float, least: float, most_samples: int, best: FloatArray
) -> bool:
    """Write the homography of four members with the least MSAC score; False where none has enough inliers."""
    places = np.flatnonzero(members)
    n = places.shape[0]
    if n < SAMPLE:
        return False
    trial, rows, chosen = np.empty((3, 3)), np.empty((2, 9)), np.empty(SAMPLE, dtype=np.int64)
    score, found, needed, drawn, state = math.inf, False, float(most_samples), 0, 1
    share = 1.0 - 0.5 * least / n
    # Wrong matches that stand side by side must not come first for every sample.
    stride = _coprime(int(GOLDEN * n), n)
    while drawn < needed:
        drawn += 1
        state = draw(state, n, chosen)
        if not _homography_of_four(matches.bearings, places[chosen], trial):
            continue
        here, wrong = 0.0, 0
        for k in range(n):
            distance = map_distance(matches, int(places[k * stride % n]), trial, rows)
            wrong += distance >= gate
            here += min(distance * distance, gate * gate)
            if here >= score or wrong > n - least or wrong > HEAD_START + share * k:
                here = math.inf
                break
        if here < score:
            score, found = here, True
            for i in range(9):
                best[i // 3, i % 3] = trial[i // 3, i % 3]
            clean = min(((n - wrong) / n) ** SAMPLE, 1.0 - 1e-12)
            needed = min(needed, math.log(1.0 - CONFIDENCE) / math.log(1.0 - clean) + 1.0)
    return found


@leaf
def _coprime(first: int, n: int) -> int:
    """Return the first whole number from ``first`` on that shares no factor with ``n``."""
    stride = max(first, 1)
    while True:
        a, b = stride, n
        while b > 0:
            a, b = b, a % b
        if a == 1:
            return stride
        stride += 1


@kernel
def _homography_of_four(bearings: FloatArray, chosen: IntArray, g: FloatArray) -> bool:
    """Write the G (3, 3) with G b* ∝ b for four matches; False where a factor is not positive.

    With the first three as columns, B and B*, G = B diag(β/α) B*⁻¹ for α = B*⁻¹ b₄*, β = B⁻¹ b₄.
    """
    initial, goal = np.empty((3, 3)), np.empty((3, 3))
    for k in range(3):
        for i in range(3):
            initial[i, k] = bearings[chosen[k], i]
            goal[i, k] = bearings[chosen[k], 3 + i]
    back, inverse = np.empty((3, 3)), np.empty((3, 3))
    if not (_invert(initial, back) and _invert(goal, inverse)):
        return False
    last = chosen[3]
    for k in range(3):
        alpha, beta = 0.0, 0.0
        for i in range(3):
            alpha += inverse[k, i] * bearings[last, 3 + i]
            beta += back[k, i] * bearings[last, i]
        if not beta * alpha > 1e-12 * alpha * alpha or abs(alpha) < 1e-9:
            return False
        for i in range(3):
            inverse[k, i] *= beta / alpha
    norm = 0.0
    for i in range(3):
        for c in range(3):
            g[i, c] = 0.0
            for k in range(3):
                g[i, c] += initial[i, k] * inverse[k, c]
            norm += g[i, c] * g[i, c]
    scale = 1.0 / math.sqrt(norm)
    for i in range(9):
        g[i // 3, i % 3] *= scale
    return True


@leaf
def _invert(m: FloatArray, inverse: FloatArray) -> bool:
    """Write the inverse of a 3×3 matrix; False where it is singular."""
    for i in range(3):
        for k in range(3):
            a, b, c, d = (i + 1) % 3, (i + 2) % 3, (k + 1) % 3, (k + 2) % 3
            inverse[k, i] = m[a, c] * m[b, d] - m[a, d] * m[b, c]
    determinant = m[0, 0] * inverse[0, 0] + m[0, 1] * inverse[1, 0] + m[0, 2] * inverse[2, 0]
    if abs(determinant) < 1e-12:
        return False
    for i in range(9):
        inverse[i // 3, i % 3] /= determinant
    return True
