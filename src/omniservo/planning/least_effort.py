"""From a proven path to one of least bending energy nearby that is proven as well (method section 6)."""

import math

import numpy as np

from omniservo.geometry.arrays import FloatArray
from omniservo.geometry.kernel import kernel
from omniservo.geometry.polynomial import PROVEN, REFUTED, bernstein_from_power
from omniservo.planning.bending import bending_energy
from omniservo.planning.constraints.demands import Demands
from omniservo.planning.descent import (
    Family,
    add_sample,
    descend,
    path_family,
    set_uniform_samples,
    unknowns,
)
from omniservo.planning.prove_path import prove_path
from omniservo.planning.search import capped_targets, end_values, power_path

SAMPLES = 12
"""Samples at first; places where a proof fails are added."""

PULL = 1e-3
"""Weight of the bending energy: small against the constraints, large against rounding."""

LEFT = 2e-6
"""What the active constraints keep, dimensionless."""

ROUNDS = 16
"""Descents at most."""


@kernel
def offsets_of(family: Family, ell: float, rotation: FloatArray, translation: FloatArray) -> FloatArray:
    """Return the unknowns x (`descent`) of a path given by powers."""
    phi, t = bernstein_from_power(rotation), bernstein_from_power(translation)
    sigma, tau = phi.shape[1] - 1, t.shape[1] - 1
    x = np.empty(unknowns(family))
    for k in range(1, sigma):
        for c in range(4):
            straight = k / sigma * family.quaternion[c] + (1.0 - k / sigma if c == 3 else 0.0)
            x[4 * (k - 1) + c] = phi[c, k] - straight
    for k in range(1, tau):
        for c in range(3):
            straight = k / tau * family.translation[c]
            x[4 * (sigma - 1) + 3 * (k - 1) + c] = (t[c, k] - straight) / ell
    return x


@kernel
def path_energy(family: Family, ell: float, rotation: FloatArray, translation: FloatArray) -> float:
    """Return ∫‖t″‖² dw / ℓ² + ∫‖φ″‖² dw of a path given by powers."""
    turn = bending_energy(bernstein_from_power(rotation), family.rotation_form)
    return turn + bending_energy(bernstein_from_power(translation), family.translation_form) / (ell * ell)


@kernel
def shift_targets(ends: FloatArray, least: FloatArray, targets: FloatArray) -> float:
    """Move every target by what its constraint misses (method of multipliers); return the largest miss.

    A hinge that the bending energy pulls on settles below its target by a fixed amount; the target is
    raised by it, and lowered again where more than LEFT is kept.
    """
    worst = 0.0
    for i in range(targets.shape[0]):
        goal = max(0.0, min(LEFT, 0.5 * ends[i]))
        miss = goal - least[i]
        moved = max(goal, targets[i] + miss) if math.isfinite(miss) else goal
        if moved > goal or miss > 0.0:
            worst = max(worst, abs(miss))
        targets[i] = moved
    return worst


@kernel
def least_effort(
    demands: Demands,
    quaternion: FloatArray,
    goal: FloatArray,
    rotation: FloatArray,
    translation: FloatArray,
) -> tuple[FloatArray, FloatArray, float]:
    """Return φ and t by powers, proven, and their energy; the given path where nothing better is found.

    Args:
        demands: the problem.
        quaternion: φ(1) (4,).
        goal: t(1) (3,) [m].
        rotation: a proven path's φ (4, σ+1).
        translation: its t (3, τ+1).
    """
    ell = demands.numbers[2]
    family = path_family(quaternion, goal, rotation.shape[1] - 1, translation.shape[1] - 1)
    ends = end_values(demands, family)
    x = offsets_of(family, ell, rotation, translation)
    best = path_energy(family, ell, rotation, translation)
    targets, least = capped_targets(ends, LEFT), np.empty_like(ends)
    set_uniform_samples(family, SAMPLES)
    for _ in range(ROUNDS):
        descend(demands, family, x, targets, PULL, math.inf, 1e-6, least)
        miss = shift_targets(ends, least, targets)
        if miss > 2e-5:
            continue
        tried, centre = power_path(family, ell, x)
        status, w = prove_path(demands, tried, centre)
        energy = path_energy(family, ell, tried, centre)
        if status == PROVEN:
            if energy < best:
                rotation, translation, best = tried, centre, energy
            break
        if status != REFUTED or not add_sample(family, w):
            for i in range(targets.shape[0]):
                targets[i] = min(targets[i] + 1e-4, 0.5 * ends[i])
    return rotation, translation, best
