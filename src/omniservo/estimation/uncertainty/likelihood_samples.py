"""Samples of motion and structure where the likelihood is not a normal law: curved valleys, rival minima.

The stretched normal law proposes motions. Each is kept in proportion to exp(−(S − S₀)/2σ²) over the density
that it was proposed with, S the cost of its best structure, so those that are kept are distributed as the
likelihood says. The points are then what the pixels show under that motion, each its own noise away.
"""

from __future__ import annotations

import math

import numpy as np
from scipy.spatial.transform import RigidTransform, Rotation

from omniservo.estimation.matches import Matches
from omniservo.estimation.minimal_solvers.essential_matrix import linear_structure, mark_in_front
from omniservo.estimation.refinement.epipolar_refinement import essential_matrix, sampson_cost
from omniservo.estimation.refinement.joint_refinement import FARTHEST
from omniservo.estimation.refinement.normal_blocks import empty_blocks, invert_point_block, linearise
from omniservo.estimation.uncertainty.joint_uncertainty import JointUncertainty
from omniservo.geometry.arrays import FloatArray, IntArray
from omniservo.geometry.kernel import kernel, leaf

PROPOSALS, MORE = 8, 64
"""for every sample that is kept; the second where the first repeat motions"""

MOST = 1_000_000
"""proposals at most, where there are more than the first"""

REPEATED = 1.5
"""Motions that are kept more than once are likely ones of which few were proposed."""

POINT_STEPS = 2
"""Newton steps from the linear structure to that of least reprojection error."""

POINT_DAMPING = 1e-6


def likelihood_samples(
    matches: Matches,
    pose: RigidTransform,
    points: FloatArray,
    law: JointUncertainty,
    tau: FloatArray,
    rng: np.random.Generator,
    shown: IntArray,
    proposals: int = PROPOSALS,
) -> tuple[FloatArray, float]:
    """Return samples of dx (K, 6 + 3m) by the likelihood, and how often their motions repeat (`repeats_of`).

    Args:
        matches: the inliers' measured pixels, weighted by their σ.
        pose: initial_T_goal, the optimum.
        points: (n, 3) [m], the optimum.
        law: the stretched law of the points that are shown.
        tau: (K,) proposed factors of σ.
        rng: where the numbers come from.
        shown: (m,) of the n points, whose samples are wanted.
        proposals: for every sample, at first.
    """
    rotation, translation = np.ascontiguousarray(pose.rotation.as_matrix()), pose.translation
    rows, sigma = law.noise[:, :6], matches.noise_px or 1.0
    length, count = float(np.linalg.norm(translation)), len(tau)
    factors = np.repeat(tau, proposals)
    proposed = factors[:, None] * (rng.standard_normal((len(factors), len(rows))) @ rows)
    direction = translation / length
    along = proposed[:, :3] @ direction
    across = proposed[:, :3] - along[:, None] * direction
    basis = np.zeros((6, 5))
    basis[:3, :2], basis[3:, 2:] = np.linalg.svd(direction[None])[2][1:].T, np.eye(3)
    inner = proposed @ basis
    squares = np.einsum("ki,ij,kj->k", inner, np.linalg.inv(basis.T @ rows.T @ rows @ basis), inner)
    towards = direction + across / length
    towards /= np.linalg.norm(towards, axis=1, keepdims=True)
    turns = rotation @ Rotation.from_rotvec(proposed[:, 3:]).as_matrix()
    excess = _excess_costs(matches, (turns, towards), (rotation, direction))
    gains = 0.5 * (squares - excess / sigma**2) / factors**2
    chosen = _resampled(rng, gains, count)
    repeats, more = repeats_of(chosen), min(MORE, MOST // count)
    if repeats > REPEATED and proposals == PROPOSALS < more:
        return likelihood_samples(matches, pose, points, law, tau, rng, shown, more)
    found = np.empty((count, len(shown), 3))
    structures(
        matches.parameters,
        matches.pixels[shown],
        matches.weights[shown],
        matches.bearings[shown],
        turns[chosen],
        towards[chosen],
        found,
    )
    lengths = length + along[chosen]
    shifts = lengths[:, None] * towards[chosen] - translation
    moved = lengths[:, None, None] * found + law.draw_own(rng, factors[chosen]) - points[shown]
    return np.concatenate((shifts, proposed[chosen, 3:], moved.reshape(count, -1)), axis=1), repeats


def _excess_costs(
    matches: Matches, motions: tuple[FloatArray, FloatArray], optimum: tuple[FloatArray, FloatArray]
) -> FloatArray:
    """Return S − S₀ (k,) [px²] of motions, rotations (k, 3, 3) and directions (k, 3)."""
    turns, towards = (np.concatenate((m, o[None])) for m, o in zip(motions, optimum, strict=True))
    costs = np.empty(len(turns))
    motion_costs(matches.bearings, matches.jacobians, turns, towards, costs)
    gone: FloatArray = costs[:-1] - costs[-1]
    return gone


def repeats_of(chosen: IntArray) -> float:
    """Return how often the choice of one of the K samples is among them, on average, Σc²/K.

    K/repeats is the effective sample size (Kish): a mean varies as one over so many independent samples.
    """
    _, times = np.unique(chosen, return_counts=True)
    return float((times**2).sum() / len(chosen))


def _resampled(rng: np.random.Generator, gains: FloatArray, count: int) -> IntArray:
    """Return ``count`` rows, drawn evenly by their weights exp(gain), in random order."""
    weights = np.exp(gains - gains.max())
    places = (np.arange(count) + rng.uniform()) / count
    rows = np.searchsorted(np.cumsum(weights) / weights.sum(), places).clip(0, len(gains) - 1)
    return rng.permutation(rows).astype(np.int64)


@kernel
def motion_costs(
    bearings: FloatArray,
    jacobians: FloatArray,
    rotations: FloatArray,
    translations: FloatArray,
    costs: FloatArray,
) -> None:
    """Write S of each motion (k,) [px²]; infinity where a point goes behind that the last has in front."""
    last = rotations.shape[0] - 1
    essential, in_front = np.empty((3, 3)), np.empty(bearings.shape[0], dtype=np.bool_)
    asked = np.empty(bearings.shape[0], dtype=np.bool_)
    mark_in_front(bearings, rotations[last], translations[last], asked)
    for k in range(rotations.shape[0]):
        essential_matrix(rotations[k], translations[k], essential)
        mark_in_front(bearings, rotations[k], translations[k], in_front)
        costs[k] = sampson_cost(bearings, jacobians, math.inf, essential)
        for j in range(asked.shape[0]):
            if asked[j] and not in_front[j]:
                costs[k] = math.inf


@kernel
def structures(
    parameters: FloatArray,
    pixels: FloatArray,
    weights: FloatArray,
    bearings: FloatArray,
    rotations: FloatArray,
    translations: FloatArray,
    points: FloatArray,
) -> None:
    """Write the points (k, n, 3) of least reprojection error under each motion, lengths of its t."""
    n = pixels.shape[0]
    blocks, inverse = empty_blocks(n), np.empty(6)
    for k in range(rotations.shape[0]):
        linear_structure(bearings, rotations[k], translations[k], points[k])
        for _ in range(POINT_STEPS):
            cost = linearise(parameters, pixels, weights, rotations[k], translations[k], points[k], blocks)
            if not cost < math.inf:
                break
            for j in range(n):
                if invert_point_block(blocks.points[j], POINT_DAMPING, inverse):
                    _step(inverse, blocks.point_gradients[j], points[k, j])


@leaf
def _step(inverse: FloatArray, gradient: FloatArray, point: FloatArray) -> None:
    """Move a point by −V⁻¹g: its direction by the part across it, its inverse distance by the part along."""
    x, y, z = gradient[0], gradient[1], gradient[2]
    dx = -(inverse[0] * x + inverse[1] * y + inverse[3] * z)
    dy = -(inverse[1] * x + inverse[2] * y + inverse[4] * z)
    dz = -(inverse[3] * x + inverse[4] * y + inverse[5] * z)
    square = point[0] ** 2 + point[1] ** 2 + point[2] ** 2
    along = (point[0] * dx + point[1] * dy + point[2] * dz) / square
    distance = min(math.sqrt(square) / (1.0 - min(along, 0.9)), FARTHEST)
    x, y, z = (1.0 - along) * point[0] + dx, (1.0 - along) * point[1] + dy, (1.0 - along) * point[2] + dz
    scale = distance / math.sqrt(x * x + y * y + z * z)
    point[0], point[1], point[2] = scale * x, scale * y, scale * z
