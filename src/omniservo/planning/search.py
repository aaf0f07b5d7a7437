"""From a problem to a proven path: straight line, then detours, then higher degrees (method section 6)."""

import math

import numpy as np

from omniservo.geometry.arrays import FloatArray, IntArray
from omniservo.geometry.kernel import kernel
from omniservo.geometry.polynomial import PROVEN, REFUTED
from omniservo.planning.constraints.demands import Demands
from omniservo.planning.descent import Family, fill, path_family, unknowns
from omniservo.planning.economise import economise
from omniservo.planning.settle import PULL, end_values, path_energy, settle

FEW = 12
"""Starts a degree before the next degree is tried."""

SPREAD = (0.7548776662466927, 0.5698402909980532, 0.6180339887498949)
"""Multiples of these, modulo 1, fill directions and sizes evenly and independently of each other."""


@kernel
def start_offsets(family: Family, ell: float, index: int, phase: float, x: FloatArray) -> None:
    """Write start ``index``: 0 the straight line, then sideways detours all round, growing.

    A detour offsets every inner control point by one vector: across t(1), or in any direction where the
    camera mostly turns on the spot. Every second one also tilts φ.
    """
    fill(x, 0.0)
    if index == 0:
        return
    angle = phase + 2.0 * math.pi * SPREAD[0] * index
    size = (0.2 + 0.12 * math.sqrt(index)) * (0.4 + 1.2 * ((SPREAD[2] * index) % 1.0))
    t = family.translation
    distance = math.sqrt(t[0] * t[0] + t[1] * t[1] + t[2] * t[2])
    height = 1.0 - 2.0 * ((SPREAD[1] * index) % 1.0)
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
def smallest(values: FloatArray) -> float:
    """Return the smallest of ``values``."""
    least = math.inf
    for i in range(values.shape[0]):
        least = min(least, values[i])
    return least


@kernel
def search(
    demands: Demands,
    quaternion: FloatArray,
    translation: FloatArray,
    degrees: IntArray,
    starts: int,
    phase: float,
    thrifty: bool,
) -> tuple[int, FloatArray, FloatArray, FloatArray]:
    """Return status, φ and t by powers, and facts: the first proven path, or the best attempt.

    Args:
        demands: the problem.
        quaternion: φ(1) (4,).
        translation: t(1) (3,) [m].
        degrees: highest σ and τ (2,).
        starts: so many starts at the highest degree, `FEW` at each one below.
        phase: turns the directions of the detours [rad].
        thrifty: then go on to the path of least effort nearby; where that is not proven, part of the way.

    Returns:
        PROVEN or REFUTED (not found); (4, σ+1); (3, τ+1) [m], highest power first; facts (4,): the start,
        the w where the last proof failed, the energy (`path_energy`) found, and the energy returned.
    """
    highest, ell = max(degrees[0], degrees[1]), demands.numbers[2]
    family = path_family(quaternion, translation, degrees[0], degrees[1])
    ends = end_values(demands, family)
    least, facts = np.empty_like(ends), np.zeros(4)
    best, best_rotation, best_translation = -math.inf, np.empty((4, 0)), np.empty((3, 0))
    for degree in range(1, highest + 1):
        family = path_family(quaternion, translation, min(degree, degrees[0]), min(degree, degrees[1]))
        x = np.empty(unknowns(family))
        count = 1 if degree == 1 else starts if degree == highest else FEW
        for start in range(count):
            start_offsets(family, ell, start, phase, x)
            fill(least, -1e300)
            status, turn, move, w = settle(demands, family, ends, PULL, x, least)
            worst = smallest(least)
            if status == PROVEN or worst > best:
                best, best_rotation, best_translation = worst, turn, move
                facts[0], facts[1] = start, w
                facts[2] = facts[3] = path_energy(family, ell, x)
            if status != PROVEN:
                continue
            if thrifty and degree > 1:
                status, turn, move, energy = economise(demands, family, ends, x, least)
                if status == PROVEN:
                    facts[3] = energy
                    return PROVEN, turn, move, facts
            return PROVEN, best_rotation, best_translation, facts
    return REFUTED, best_rotation, best_translation, facts
