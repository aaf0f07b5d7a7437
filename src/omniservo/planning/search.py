"""From a problem to a proven path: straight line, then detours, then higher degrees (method section 6)."""

import math

import numpy as np

from omniservo.geometry.arrays import FloatArray, IntArray
from omniservo.geometry.kernel import kernel
from omniservo.geometry.polynomial import PROVEN, REFUTED, power_from_bernstein
from omniservo.planning.constraints.demands import Demands
from omniservo.planning.descent import (
    Family,
    add_sample,
    descend,
    fill,
    groups,
    linearise,
    path_controls,
    path_family,
    reached,
    set_uniform_samples,
    unknowns,
)
from omniservo.planning.prove_path import prove_path

SAMPLES = 8
"""Samples at first; the proof is trusted, not they."""

TARGET = 0.03
"""What a constraint's dimensionless value is pushed to at first (a limit: about radians)."""

PULL = 1e-5
"""Weight of the bending energy while searching: only enough to fix what no constraint fixes."""

ROUNDS = 6
"""So often an attempt is proven, and continued with the place where it failed as a new sample."""

FEW = 12
"""Starts a degree before the next degree is tried."""

GOLDEN_ANGLE = math.pi * (3.0 - math.sqrt(5.0))


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
def start_offsets(family: Family, ell: float, index: int, phase: float, x: FloatArray) -> None:
    """Write start ``index``: 0 the straight line, then sideways detours at golden angles, growing.

    A detour offsets every inner control point by one vector: across t(1), or in any direction where the
    camera mostly turns on the spot. Every second one also tilts φ.
    """
    fill(x, 0.0)
    if index == 0:
        return
    angle = phase + index * GOLDEN_ANGLE
    size = 0.2 + 0.12 * math.sqrt(index)
    t = family.translation
    distance = math.sqrt(t[0] * t[0] + t[1] * t[1] + t[2] * t[2])
    height = 1.0 - 2.0 * ((index * 0.618034) % 1.0)
    ring = math.sqrt(1.0 - height * height)
    a, b, c = ring * math.cos(angle), ring * math.sin(angle), height
    if distance > 0.05 * ell:
        along = (a * t[0] + b * t[1] + c * t[2]) / (distance * distance)
        a, b, c = a - along * t[0], b - along * t[1], c - along * t[2]
        size /= max(math.sqrt(a * a + b * b + c * c), 1e-6)
    inner = family.rotation_form.shape[0]
    for k in range(4 * inner, x.shape[0], 3):
        x[k], x[k + 1], x[k + 2] = size * a, size * b, size * c
    if index % 2 == 1:
        return
    tilt = 0.3 * math.sqrt(index)
    for k in range(inner):
        x[4 * k] = tilt * ring * math.sin(2.0 * angle)
        x[4 * k + 1] = tilt * height
        x[4 * k + 2] = tilt * ring * math.cos(2.0 * angle)


@kernel
def attempt(
    demands: Demands, family: Family, ends: FloatArray, x: FloatArray, least: FloatArray
) -> tuple[int, FloatArray, FloatArray, float]:
    """Descend from x in place and prove; a refuted path gets its witness as a sample.

    Returns the status, φ and t by powers, and the w where the proof failed.
    """
    ell, target = demands.numbers[2], TARGET
    set_uniform_samples(family, SAMPLES)
    status, w = REFUTED, 0.5
    rotation, translation = power_path(family, ell, x)
    for _ in range(ROUNDS):
        if x.shape[0] > 0:
            targets = capped_targets(ends, target)
            descend(demands, family, x, targets, PULL, 0.5, 1e-3, least)
            rotation, translation = power_path(family, ell, x)
            if not reached(least, targets, 1e-3):
                return REFUTED, rotation, translation, w
        status, w = prove_path(demands, rotation, translation)
        if status == PROVEN or x.shape[0] == 0:
            break
        if status == REFUTED and not add_sample(family, w):
            break
        target *= 1.5
    return status, rotation, translation, w


@kernel
def search(
    demands: Demands,
    quaternion: FloatArray,
    translation: FloatArray,
    degrees: IntArray,
    starts: int,
    phase: float,
) -> tuple[int, FloatArray, FloatArray, int, float]:
    """Return (status, φ and t by powers, start, w): the first proven path, or the best attempt.

    Args:
        demands: the problem.
        quaternion: φ(1) (4,).
        translation: t(1) (3,) [m].
        degrees: highest σ and τ (2,).
        starts: so many starts at the highest degree, `FEW` at each one below.
        phase: turns the directions of the detours [rad].
    """
    highest = max(degrees[0], degrees[1])
    family = path_family(quaternion, translation, degrees[0], degrees[1])
    ends = end_values(demands, family)
    least = np.empty_like(ends)
    best, best_start, best_w = -math.inf, 0, 0.0
    best_rotation, best_translation = np.empty((4, 0)), np.empty((3, 0))
    for degree in range(1, highest + 1):
        family = path_family(quaternion, translation, min(degree, degrees[0]), min(degree, degrees[1]))
        x = np.empty(unknowns(family))
        count = 1 if degree == 1 else starts if degree == highest else FEW
        for start in range(count):
            start_offsets(family, demands.numbers[2], start, phase, x)
            fill(least, -1e300)
            status, turn, move, w = attempt(demands, family, ends, x, least)
            worst = math.inf if status == PROVEN else smallest(least)
            if worst > best:
                best, best_start, best_w = worst, start, w
                best_rotation, best_translation = turn, move
            if status == PROVEN:
                return status, turn, move, start, w
    return REFUTED, best_rotation, best_translation, best_start, best_w
