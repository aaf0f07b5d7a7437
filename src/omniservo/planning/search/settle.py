"""From one start to a proven path: descend, prove, look where the proof failed, descend again.

Constraints are pushed to a target well above 0, and the descent stops as soon as half of it is reached.
"""

import math

import numpy as np

from omniservo.geometry.arrays import FloatArray
from omniservo.geometry.held import held
from omniservo.geometry.kernel import inlined, kernel
from omniservo.geometry.polynomial import power_from_bernstein
from omniservo.geometry.subdivision import PROVEN, REFUTED
from omniservo.geometry.vectors import fill
from omniservo.planning.constraints.constraints import Constraints
from omniservo.planning.search.descent import descend, linearise, reached, room_for
from omniservo.planning.search.path_family import (
    PathFamily,
    add_sample,
    path_controls,
    set_uniform_samples,
    unknowns,
)
from omniservo.planning.search.prove_path import prove_path

SAMPLES = 6
"""Samples at first: the proof is trusted, not they."""

TARGET = 0.03
"""What a constraint's dimensionless value is pushed to (an image limit: about radians)."""

PULL = 1e-5
"""Weight of the bending energy: only enough to fix what no constraint fixes."""

ROUNDS = 6
"""Descents at most."""

HIGHER = 1.5
"""The target rises by this factor after a proof that fails."""


@kernel
def power_path(family: PathFamily, ell: float, x: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return the power coefficients of φ and t for the offsets x."""
    phi, t = path_controls(family, ell, x)
    return power_from_bernstein(phi), power_from_bernstein(t)


@inlined
def end_values(constraints: Constraints, family: PathFamily) -> FloatArray:
    """Return the smallest g of every group at the two end poses, which no path can improve."""
    family.samples[0] = 0
    add_sample(family, 0.0)
    add_sample(family, 1.0)
    size = unknowns(family)
    least = np.empty(constraints.slots.total)
    targets = np.empty(least.shape[0])
    fill(targets, -math.inf)
    room = held(room_for(2, constraints.points.shape[0]))
    linearise(constraints, family, np.zeros(size), targets, 0.0, room, least, np.empty((size, size + 1)))
    return least


@inlined
def capped_targets(ends: FloatArray, target: float) -> FloatArray:
    """Return min(target, half of what the end poses leave), at least 0."""
    targets = np.empty_like(ends)
    for i in range(ends.shape[0]):
        targets[i] = max(0.0, min(target, 0.5 * ends[i]))
    return targets


@inlined
def settle(
    constraints: Constraints,
    family: PathFamily,
    ends: FloatArray,
    pull: float,
    x: FloatArray,
    least: FloatArray,
) -> tuple[int, FloatArray, FloatArray, float]:
    """Descend from x in place and prove, with every place where the proof fails as a further sample.

    Args:
        constraints: the problem.
        family: where to move.
        ends: `end_values`.
        pull: weight of the bending energy.
        x: offsets, see `path_family`.
        least: the smallest g of every group at the samples is written here; −∞ where nothing can be moved.

    Returns:
        status, φ and t by powers, and the w where the proof failed.
    """
    ell = constraints.ell
    fill(least, -math.inf)
    set_uniform_samples(family, SAMPLES)
    target, status, w = TARGET, REFUTED, 0.5
    rotation, translation = power_path(family, ell, x)
    for _ in range(ROUNDS):
        targets = capped_targets(ends, target)
        if x.shape[0] > 0:
            descend(constraints, family, x, targets, pull, least)
            rotation, translation = power_path(family, ell, x)
            if not reached(least, targets, 1e-3):
                return REFUTED, rotation, translation, w
        status, w = prove_path(constraints, rotation, translation)
        if status == PROVEN or x.shape[0] == 0:
            return status, rotation, translation, w
        if status == REFUTED:
            add_sample(family, w)
        target *= HIGHER
    return min(status, 0), rotation, translation, w
