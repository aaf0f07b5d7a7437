"""From one start to a proven path: descend, prove, look where the proof failed, descend again.

Two aims. *Any* path: constraints are pushed to a target well above 0, and the descent stops as soon as half
of it is reached. The path of *least effort* nearby: the bending energy (method section 6) is lowered until
the active constraints keep next to nothing.
"""

import math

import numpy as np

from omniservo.geometry.arrays import FloatArray
from omniservo.geometry.kernel import kernel
from omniservo.geometry.polynomial import PROVEN, REFUTED, power_from_bernstein
from omniservo.planning.constraints.demands import Demands
from omniservo.planning.descent import descend, fill, groups, linearise, reached
from omniservo.planning.path_family import (
    Family,
    add_sample,
    path_controls,
    set_uniform_samples,
    unknowns,
)
from omniservo.planning.prove_path import prove_path

SAMPLES, THRIFTY_SAMPLES = 8, 12
"""Samples at first: the proof is trusted, not they."""

TARGET = 0.03
"""What a constraint's dimensionless value is pushed to for any path (an image limit: about radians)."""

LEFT = 1e-4
"""What the active constraints keep for the least effort, at first; more where a proof asks for it."""

PULL, THRIFTY_PULL = 1e-5, 1e-2
"""Weight of the bending energy; for any path only enough to fix what no constraint fixes.

Which of the two is given also says which aim is meant: a flag would be compiled once for each value."""

ROUNDS, THRIFTY_ROUNDS = 6, 20
"""Descents at most."""

OVER = 1.2
"""A target is raised by so many times what is missed."""

SPARE = 2e-3
"""More than this is not kept where the bending energy pulls."""

PATIENCE = 7
"""After so many descents to the least effort more and more is kept: targets that do not settle end so."""

ENOUGH = 0.5
"""The part of the target at which the descent to any path stops."""

DAMPING, THRIFTY_DAMPING = 1e-6, 1e-2
"""of the first step of a descent; a path that must not become worse takes it shorter."""


@kernel
def power_path(family: Family, ell: float, x: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return the power coefficients of φ and t for the offsets x."""
    phi, t = path_controls(family, ell, x)
    return power_from_bernstein(phi), power_from_bernstein(t)


@kernel
def end_values(demands: Demands, family: Family) -> FloatArray:
    """Return the smallest g of every group at the two end poses, which no path can improve."""
    family.samples[0] = 0
    add_sample(family, 0.0)
    add_sample(family, 1.0)
    size = unknowns(family)
    least = np.empty(groups(demands))
    targets = np.empty(least.shape[0])
    fill(targets, -math.inf)
    linearise(demands, family, np.zeros(size), targets, 0.0, least, np.empty((size, size + 1)))
    return least


@kernel
def smallest(values: FloatArray) -> float:
    """Return the smallest of ``values``."""
    least = math.inf
    for i in range(values.shape[0]):
        least = min(least, values[i])
    return least


@kernel
def capped_targets(ends: FloatArray, target: float) -> FloatArray:
    """Return min(target, half of what the end poses leave), at least 0."""
    targets = np.empty_like(ends)
    for i in range(ends.shape[0]):
        targets[i] = max(0.0, min(target, 0.5 * ends[i]))
    return targets


@kernel
def shift_targets(ends: FloatArray, least: FloatArray, left: float, targets: FloatArray) -> bool:
    """Move every target by what its constraint misses (method of multipliers); tell whether that was little.

    A hinge that the bending energy pulls on settles below its target by a fixed amount; the target is
    raised by it, and lowered again where more than ``left`` is kept.
    """
    settled = True
    for i in range(targets.shape[0]):
        goal = max(0.0, min(left, 0.5 * ends[i]))
        miss = goal - least[i]
        if not math.isfinite(miss):
            targets[i] = goal
            continue
        settled = settled and miss <= 0.5 * left and (targets[i] <= goal or miss >= -max(SPARE, left))
        targets[i] = max(goal, targets[i] + (OVER if miss > 0.0 else 1.0) * miss)
    return settled


@kernel
def settle(
    demands: Demands, family: Family, ends: FloatArray, pull: float, x: FloatArray, least: FloatArray
) -> tuple[int, FloatArray, FloatArray, float]:
    """Descend from x in place and prove, with every place where the proof fails as a further sample.

    Args:
        demands: the problem.
        family: where to move.
        ends: `end_values`.
        pull: PULL to aim at any path, THRIFTY_PULL at the least effort.
        x: offsets, see `descent`.
        least: the smallest g of every group at the samples is written here.

    Returns:
        status, φ and t by powers, and the w where the proof failed.
    """
    ell, failures, thrifty = demands.numbers[2], 0, pull == THRIFTY_PULL
    set_uniform_samples(family, THRIFTY_SAMPLES if thrifty else SAMPLES)
    target = LEFT if thrifty else TARGET
    targets = capped_targets(ends, target)
    status, w = REFUTED, 0.5
    rotation, translation = power_path(family, ell, x)
    rounds, enough, damping, sleepers = ROUNDS, ENOUGH, DAMPING, targets.shape[0]
    if thrifty:  # then a path that shrinks to the straight line must see the obstacles on its way
        rounds, enough, damping, sleepers = (
            THRIFTY_ROUNDS,
            math.inf,
            THRIFTY_DAMPING,
            demands.limits.shape[0] + 2,
        )
    for done in range(1, rounds + 1):
        if x.shape[0] > 0:
            descend(demands, family, x, targets, pull, enough, damping, sleepers, least)
            rotation, translation = power_path(family, ell, x)
            if thrifty and done > PATIENCE:
                target *= 1.7
            if thrifty and not shift_targets(ends, least, target, targets) and done < rounds:
                continue
            if not thrifty and not reached(least, targets, 1e-3):
                return REFUTED, rotation, translation, w
        status, w = prove_path(demands, rotation, translation)
        if status == PROVEN or x.shape[0] == 0:
            return status, rotation, translation, w
        failures += 1
        added = status == REFUTED and add_sample(family, w)
        if not thrifty:
            target *= 1.5
            targets = capped_targets(ends, target)
        elif failures > 2 or not added:
            target *= 3.0
    return min(status, 0), rotation, translation, w
