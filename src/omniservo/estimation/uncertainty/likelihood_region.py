"""How far the motion may be from its optimum: the region that the likelihood leaves, not its linear image.

With few points and real noise the cost has long curved valleys and more than one minimum, and the ellipsoid
of the linearised cost covers the truth far less often than it says. The region of all motions with
S ≤ S₀ + q σ² does cover it. Its tips, the farthest places along the ellipsoid's axes, are found by walking up
the valleys; an ellipsoid that leaves out a tip, or another minimum in the region, is stretched to it.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from scipy.spatial.transform import Rotation
from scipy.special import chdtri, fdtri

from omniservo.estimation.matches import Matches
from omniservo.estimation.minimal_solvers.essential_matrix import ray_distances
from omniservo.estimation.refinement.epipolar_refinement import (
    accumulate_distances,
    essential_matrix,
    move_motion,
    sampson_cost,
    tangent_plane,
)
from omniservo.estimation.refinement.motion_search import Minimum
from omniservo.estimation.robust.members import GATE
from omniservo.geometry.arrays import FloatArray
from omniservo.geometry.kernel import kernel, leaf
from omniservo.geometry.linear_systems import factor_cholesky, solve_factored

LEVEL = 0.95
"""Confidence of the region, and of the ellipsoid that is stretched to it."""

STEPS = 6
"""of a walk to a tip; the last two stay at the region's border."""

LONGEST_STEP = 0.5
"""of a walk [rad]"""

HALVINGS = 8
"""of a step that leaves the region: the cost is not the model of it"""

STRAIGHT = 0.15
"""Where the cost at the ends of the longest axis differs from the linear image by no more than this part,
the region is the ellipsoid."""

LEAST_NOISE_PX = 1e-4
"""With less noise the linear image holds, and costs are rounding."""

PASSES = 3
"""over the tips; stretching to one may leave less to do for another."""


class Stretches(NamedTuple):
    """Motions that an ellipsoid σ²C is stretched to: σ²C + Σ β p pᵀ, p the motion from the optimum."""

    weights: FloatArray
    """β (k,)"""
    rotations: FloatArray
    """(k, 3, 3)"""
    translations: FloatArray
    """(k, 3) of length 1"""


def stretches(
    matches: Matches,
    optimum: tuple[FloatArray, FloatArray],
    rivals: list[Minimum],
    unscaled: FloatArray,
    variance: float,
    freedom: float,
) -> Stretches:
    """Return what the linear ellipsoid must be stretched to; nothing where the linear image holds.

    Args:
        matches: the members.
        optimum: R, t, the best minimum of their cost.
        rivals: the other minima.
        unscaled: (6, 6) C of (t, δ), for noise of 1 px over the weight, ‖t‖ = 1.
        variance: σ² [px²].
        freedom: degrees of freedom of σ; infinite where it is known.
    """
    if variance < LEAST_NOISE_PX**2:
        return Stretches(np.empty(0), np.empty((0, 3, 3)), np.empty((0, 3)))
    quantile = float(chdtri(5, 1.0 - LEVEL) if math.isinf(freedom) else 5.0 * fdtri(5, freedom, LEVEL))
    tangents, essential, basis = np.empty((2, 3)), np.empty((3, 3)), np.zeros((6, 5))
    tangent_plane(optimum[1], tangents)
    basis[:3, :2], basis[3:, 2:] = tangents.T, np.eye(3)
    ellipsoid = variance * basis.T @ unscaled @ basis
    values, axes = np.linalg.eigh(ellipsoid)
    ways = (basis @ (axes * np.sqrt(np.maximum(values, 0.0))))[:, ::-1].T
    ways = np.concatenate((ways, -ways))
    essential_matrix(*optimum, essential)
    cost = sampson_cost(matches.bearings, matches.jacobians, math.inf, essential)
    room = quantile * variance
    rotations, translations = walk_to_tips(
        matches.bearings, matches.jacobians, *optimum, ways, cost, room, quantile
    )
    near = [m for m in rivals if m.cost <= cost + room]
    rotations = np.concatenate((rotations, *(m.rotation[None] for m in near)))
    translations = np.concatenate((translations, *(m.translation[None] for m in near)))
    weights = np.zeros(0)
    if len(rotations):
        offsets = motion_offsets(*optimum, rotations, translations)
        weights = stretch_weights(ellipsoid, offsets @ basis, quantile)
    kept = weights > 0.0
    return Stretches(weights[kept], rotations[kept], translations[kept])


def motion_offsets(
    rotation: FloatArray, translation: FloatArray, rotations: FloatArray, translations: FloatArray
) -> FloatArray:
    """Return (t′ − t, rotation vector of RᵀR′) (k, 6) of motions R′ (k, 3, 3), t′ (k, 3) from R, t."""
    turns = Rotation.from_matrix(rotation.T @ rotations).as_rotvec()
    return np.concatenate((translations - translation, turns), axis=1)


def stretch_weights(ellipsoid: FloatArray, offsets: FloatArray, quantile: float) -> FloatArray:
    """Return β (k,) so that every offset p (k, 5) has pᵀ(C + Σ β p pᵀ)⁻¹p ≤ quantile, nearly."""
    inverse, found = np.linalg.inv(ellipsoid), np.zeros(len(offsets))
    for _ in range(PASSES):
        for k, p in enumerate(offsets):
            column = inverse @ p
            square = float(p @ column)
            if square > quantile:
                by = (square / quantile - 1.0) / square
                found[k] += by
                inverse = inverse - np.outer(column, column) * (by / (1.0 + by * square))
    return found


@kernel
def walk_to_tips(
    bearings: FloatArray,
    jacobians: FloatArray,
    rotation: FloatArray,
    translation: FloatArray,
    ways: FloatArray,
    cost: float,
    room: float,
    quantile: float,
) -> tuple[FloatArray, FloatArray]:
    """Return the motions (k, 3, 3), (k, 3) farthest along ``ways`` (k, 6) with a cost up to cost + room.

    The ways are axes of the linear ellipsoid, one σ long, longest first, then the opposite ones. There are
    no motions where the cost at both ends of the longest axis is as the ellipsoid says.
    """
    rotations, translations = np.empty((ways.shape[0], 3, 3)), np.empty((ways.shape[0], 3))
    half = ways.shape[0] // 2
    bent = False
    essential = np.empty((3, 3))
    for k in (0, half):
        _straight(rotation, translation, ways[k], math.sqrt(quantile), rotations[k], translations[k])
        essential_matrix(rotations[k], translations[k], essential)
        there = sampson_cost(bearings, jacobians, math.inf, essential)
        bent = bent or not abs(there - cost - room) <= STRAIGHT * room
    if not bent:
        return np.empty((0, 3, 3)), np.empty((0, 3))
    for k in range(ways.shape[0]):
        rotations[k], translations[k] = rotation, translation
        _walk(bearings, jacobians, ways[k], cost, room, quantile, rotations[k], translations[k])
    return rotations, translations


@kernel
def _straight(
    rotation: FloatArray,
    translation: FloatArray,
    way: FloatArray,
    length: float,
    trial_r: FloatArray,
    trial_t: FloatArray,
) -> None:
    """Write the motion ``length`` σ along a way."""
    tangents, step = np.empty((2, 3)), np.empty(5)
    tangent_plane(translation, tangents)
    _along(way, tangents, step)
    for i in range(5):
        step[i] *= length
    move_motion(rotation, translation, tangents, step, trial_r, trial_t)


@leaf
def _along(way: FloatArray, tangents: FloatArray, step: FloatArray) -> None:
    """Write a way (6,), (t, δ), as a step (5,), (δ, τ)."""
    for i in range(3):
        step[i] = way[3 + i]
    for i in range(2):
        step[3 + i] = tangents[i, 0] * way[0] + tangents[i, 1] * way[1] + tangents[i, 2] * way[2]


@leaf
def _is_behind(
    bearings: FloatArray,
    jacobians: FloatArray,
    j: int,
    rotation: FloatArray,
    translation: FloatArray,
    reach: float,
) -> bool:
    """Tell whether match ``j``'s rays meet behind a camera and are no parallels within ``reach`` px."""
    first, second = ray_distances(bearings, j, rotation, translation)
    if 0.0 < first < math.inf and 0.0 < second < math.inf:
        return False
    b, along, square = bearings[j], 0.0, 0.0
    for i in range(3):
        along += b[i] * (rotation[i, 0] * b[3] + rotation[i, 1] * b[4] + rotation[i, 2] * b[5])
    for i in range(jacobians.shape[1]):
        square += jacobians[j, i] * jacobians[j, i]
    # Σ jacobian² is the variance of both coordinates of the angle for pixels' of one.
    return along < 0.0 or 1.0 - along * along > 0.5 * reach * reach * square


@kernel
def write_border_step(normal: FloatArray, gradient: FloatArray, room: float, step: FloatArray) -> bool:
    """Replace a direction by the step s farthest along it with 2g·s + sᵀHs ≤ room; False: H is singular."""
    size, ahead, back = gradient.shape[0], step.copy(), gradient.copy()
    for i in range(size):
        normal[i, i] *= 1.0 + 1e-6
    if not factor_cholesky(normal, size, 1e-15):
        return False
    solve_factored(normal, size, ahead)
    solve_factored(normal, size, back)
    far = math.sqrt(max(room + (gradient * back).sum(), 0.0) / (step * ahead).sum())
    step[:] = far * ahead - back
    return True


@kernel
def _walk(
    bearings: FloatArray,
    jacobians: FloatArray,
    way: FloatArray,
    cost: float,
    room: float,
    quantile: float,
    rotation: FloatArray,
    translation: FloatArray,
) -> None:
    """Move the motion to where ``way`` is largest on the border of the region.

    Every step maximises way·s under the model S + 2g·s + sᵀHs ≤ border, and the border grows from step to
    step: the walk follows a valley that bends. It ends early where a point would go behind a camera, by more
    than a point at infinity with noise.
    """
    normal, gradient, tangents = np.empty((5, 5)), np.empty(5), np.empty((2, 3))
    essential, trial_r, trial_t = np.empty((3, 3)), np.empty((3, 3)), np.empty(3)
    step = np.empty(5)
    reach = GATE * math.sqrt(room / quantile)
    for k in range(STEPS):
        part = min(1.0, (k + 1.0) / (STEPS - 2.0))
        tangent_plane(translation, tangents)
        essential_matrix(rotation, translation, essential)
        here = accumulate_distances(
            bearings, jacobians, math.inf, rotation, essential, tangents, normal, gradient
        )
        _along(way, tangents, step)
        if not write_border_step(normal, gradient, cost + part * part * room - here, step):
            return
        step *= min(1.0, LONGEST_STEP / math.sqrt((step * step).sum() + 1e-300))
        over = True
        for _ in range(HALVINGS):
            move_motion(rotation, translation, tangents, step, trial_r, trial_t)
            essential_matrix(trial_r, trial_t, essential)
            over = sampson_cost(bearings, jacobians, math.inf, essential) > cost + (1.0 + STRAIGHT) * room
            if not over:
                break
            step *= 0.5
        if over:
            return
        for j in range(bearings.shape[0]):
            if _is_behind(bearings, jacobians, j, trial_r, trial_t, reach):
                return
        rotation[:, :], translation[:] = trial_r, trial_t
