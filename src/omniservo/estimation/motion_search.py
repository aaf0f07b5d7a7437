"""From several starts to the best motion and its best rival.

With few points the cost has more than one minimum. The starts lie in the span of the two eigenvectors of
AᵀA with the smallest eigenvalues, E = cos a e₁ + sin a e₂. The motion of each is refined first, without
structure; those that stay apart are then refined jointly with their structure and compared.
"""

import math

import numpy as np

from omniservo.estimation.epipolar_refinement import essential_matrix, refine_epipolar
from omniservo.estimation.essential_matrix import epipolar_gram, linear_structure, motion_in_front
from omniservo.estimation.joint_refinement import refine_jointly
from omniservo.estimation.linear_systems import symmetric_eigen
from omniservo.geometry.arrays import FloatArray
from omniservo.geometry.kernel import kernel

START_ANGLES = (0.0, 0.6, -0.6, 1.2, -1.2)
"""a [rad]; five starts leave 1.3% of nine-point scenes in a false minimum, one start 17%."""

EPIPOLAR_STEPS = 20
JOINT_STEPS = 30
APART = 0.05
"""Two motions are the same minimum if rotation and direction both differ by less than this [rad]."""

HOPELESS = 30.0
"""A start is dropped where its epipolar cost is this many times the best joint cost."""


@kernel
def span_of_starts(vectors: FloatArray, angles: FloatArray) -> FloatArray:
    """Return E = cos a e₁ + sin a e₂ (k, 3, 3); e₁, e₂ are the columns 0, 1 of ``vectors``."""
    essentials = np.empty((angles.shape[0], 3, 3))
    for k in range(angles.shape[0]):
        for i in range(9):
            essentials[k, i // 3, i % 3] = (
                math.cos(angles[k]) * vectors[i, 0] + math.sin(angles[k]) * vectors[i, 1]
            )
    return essentials


@kernel
def search_motion(
    parameters: FloatArray,
    pixels: FloatArray,
    bearings: FloatArray,
    jacobians: FloatArray,
    kind: int,
    loss_scale: float,
    essentials: FloatArray,
) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray, bool]:
    """Return (costs (2,), rotations (2, 3, 3), translations (2, 3), points (2, n, 3), converged).

    Row 0 is the best minimum found, row 1 the best other minimum (cost infinite: none was found).
    ``essentials`` (k, 3, 3) are the starts; the other arguments are those of ``refine_epipolar`` and
    ``refine_jointly``.
    """
    n, k = pixels.shape[0], essentials.shape[0]
    rotations, translations = np.empty((k, 3, 3)), np.empty((k, 3))
    costs, ends, done = np.full(k, math.inf), np.full(2, math.inf), np.zeros(2, dtype=np.bool_)
    r, t, h, trial = np.zeros((2, 3, 3)), np.zeros((2, 3)), np.zeros((2, n, 3)), np.empty((n, 3))
    for i in range(k):
        if motion_in_front(bearings, essentials[i], rotations[i], translations[i]) >= 0:
            costs[i], _ = refine_epipolar(
                bearings, jacobians, loss_scale, rotations[i], translations[i], EPIPOLAR_STEPS
            )
    for _ in range(k):
        i = int(np.argmin(costs))
        if costs[i] == math.inf or costs[i] > HOPELESS * ends[0]:
            break
        costs[i] = math.inf
        essential_matrix(rotations[i], translations[i], essentials[i])
        motion_in_front(bearings, essentials[i], rotations[i], translations[i])
        if _same(rotations[i], translations[i], r[0], t[0], ends[0]):
            continue
        linear_structure(bearings, rotations[i], translations[i], trial)
        cost, ok = refine_jointly(
            parameters, pixels, kind, loss_scale, rotations[i], translations[i], trial, JOINT_STEPS
        )
        if _same(rotations[i], translations[i], r[0], t[0], ends[0]):
            if cost < ends[0]:
                ends[0], r[0], t[0], h[0], done[0] = cost, rotations[i], translations[i], trial, ok
        elif cost < ends[0]:
            ends[1], r[1], t[1], h[1], done[1] = ends[0], r[0], t[0], h[0], done[0]
            ends[0], r[0], t[0], h[0], done[0] = cost, rotations[i], translations[i], trial, ok
        elif cost < ends[1]:
            ends[1], r[1], t[1], h[1], done[1] = cost, rotations[i], translations[i], trial, ok
    return ends, r, t, h, done[0]


@kernel
def _same(r: FloatArray, t: FloatArray, other_r: FloatArray, other_t: FloatArray, other_cost: float) -> bool:
    """Tell whether two motions belong to one minimum; never where the other one is empty."""
    if other_cost == math.inf:
        return False
    chord = 0.0
    for i in range(3):
        for k in range(3):
            chord += (r[i, k] - other_r[i, k]) ** 2
    cosine = t[0] * other_t[0] + t[1] * other_t[1] + t[2] * other_t[2]
    # ‖R − R'‖² = 8 sin²(angle/2), nearly 2·angle² for small angles.
    return chord < 2.0 * APART * APART and cosine > math.cos(APART)


@kernel
def motion_and_structure(
    parameters: FloatArray,
    pixels: FloatArray,
    bearings: FloatArray,
    jacobians: FloatArray,
    kind: int,
    angles: FloatArray,
    priors: FloatArray,
) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray, bool]:
    """Return :func:`search_motion` from eight-point starts at ``angles`` and from ``priors`` (k, 3, 3)."""
    weights, gram = np.ones(bearings.shape[0]), np.empty((9, 9))
    epipolar_gram(bearings, weights, gram)
    _, vectors = symmetric_eigen(gram)
    starts = span_of_starts(vectors, angles)
    k = angles.shape[0]
    essentials = np.empty((k + priors.shape[0], 3, 3))
    for i in range(essentials.shape[0]):
        essentials[i] = starts[i] if i < k else priors[i - k]
    return search_motion(parameters, pixels, bearings, jacobians, kind, math.inf, essentials)
