"""From a problem to a proven path: straight line, then detours, then higher degrees (method section 6)."""

import math

import numpy as np

from omniservo.geometry.arrays import FloatArray, IntArray
from omniservo.geometry.held import held
from omniservo.geometry.kernel import inlined, kernel, leaf
from omniservo.geometry.subdivision import PROVEN, REFUTED
from omniservo.geometry.vectors import smallest, write
from omniservo.planning.constraints.constraints import Constraints
from omniservo.planning.search.economise import economise, leads_back
from omniservo.planning.search.path_family import Ends, PathFamily, path_energy, path_family, unknowns
from omniservo.planning.search.settle import PULL, end_values, settle

FEW = 12
"""Starts a degree before the next degree is tried."""

SPREAD = (0.7548776662466927, 0.5698402909980532, 0.6180339887498949)
"""Multiples of these, modulo 1, fill directions and sizes evenly and independently of each other."""

TWISTS = (0.0, 2.1, -2.1)
"""How far detours turn from one inner control point to the next [rad]."""

NUMBER, FAILED_AT, FOUND, ENERGY, FLOOR, WORST, TRIED = range(7)
"""Facts of a search: the number of the start, the w where its last proof failed, the energy (`path_energy`)
before and after economising, the least that any path could have, the smallest g of the attempt, and how many
starts were tried, counted from the first of all: only one more where not even the end poses can be proven."""


@inlined
def start_offsets(family: PathFamily, ell: float, index: int, phase: float) -> FloatArray:
    """Return the offsets of start ``index``: 0 the straight line, then sideways detours all round, growing.

    A detour offsets every inner control point across t(1), or in any direction where the camera mostly turns
    on the spot; in every third one all go the same way, the others turn from point to point. Every second one
    also tilts φ.
    """
    x = np.zeros(unknowns(family))
    if index == 0:
        return x
    angle, size = phase + 2.0 * math.pi * SPREAD[0] * index, detour_size(index)
    t = family.translation_base[:, family.translation_base.shape[1] - 1]
    distance = math.sqrt(t[0] * t[0] + t[1] * t[1] + t[2] * t[2])
    height = 1.0 - 2.0 * ((SPREAD[1] * index) % 1.0)
    ring = math.sqrt(1.0 - height * height)
    inner = family.rotation_form.shape[0]
    for k in range(4 * inner, x.shape[0], 3):
        a, b, c, length = ring * math.cos(angle), ring * math.sin(angle), height, 1.0
        if distance > 0.05 * ell:
            along = (a * t[0] + b * t[1] + c * t[2]) / (distance * distance)
            a, b, c = a - along * t[0], b - along * t[1], c - along * t[2]
            length = max(math.sqrt(a * a + b * b + c * c), 1e-6)
        x[k], x[k + 1], x[k + 2] = size * a / length, size * b / length, size * c / length
        angle += TWISTS[index % 3]
    if index % 2 == 1:
        return x
    tilt = 0.3 * math.sqrt(index)
    for k in range(inner):
        x[4 * k] = tilt * ring * math.sin(2.0 * angle)
        x[4 * k + 1] = tilt * height
        x[4 * k + 2] = tilt * ring * math.cos(2.0 * angle)
    return x


@leaf
def detour_size(index: int) -> float:
    """Return the size of detour ``index`` over ℓ: small ones first, soon from 0.2 to 6.4, evenly in scale."""
    return float(0.2 * 2.0 ** (min(5.0, 1.0 + 0.8 * math.sqrt(index)) * ((SPREAD[2] * index) % 1.0)))


@leaf
def stiff_degree(ends: Ends) -> int:
    """Return the degree up to which the ends leave no freedom: 1, or 2 where a departure is given."""
    return 1 if ends.departure.shape[0] == 0 else 2


@leaf
def starts_in_all(ends: Ends, degrees: IntArray, most: int) -> int:
    """Return how many starts there are: one without freedom, `FEW` a degree, ``most`` at the highest one."""
    degree = max(degrees[0], degrees[1]) - stiff_degree(ends)
    return 1 if degree <= 0 else 1 + FEW * (degree - 1) + most


@inlined
def scheduled(ends: Ends, degrees: IntArray, number: int) -> tuple[int, int]:
    """Return the degree and the index among its starts of start ``number``, counted over all degrees."""
    stiff, highest = stiff_degree(ends), max(degrees[0], degrees[1])
    if number == 0:
        return min(stiff, highest), 0
    degree = min(stiff + 1 + (number - 1) // FEW, highest)
    return degree, number - 1 - FEW * (degree - stiff - 1)


@kernel
def search(
    constraints: Constraints,
    ends: Ends,
    degrees: IntArray,
    window: IntArray,
    phase: float,
    economised: int,
    beat: float,
) -> tuple[int, FloatArray, FloatArray, FloatArray]:
    """Return status, φ and t by powers, and facts: the first proven path or the best of a few, or an attempt.

    Args:
        constraints: the problem.
        ends: what all paths start and end with.
        degrees: highest σ and τ (2,).
        window: the starts to try, window[0] ≤ number < window[1]; see `scheduled`.
        phase: turns the directions of the detours [rad].
        economised: 0: the first proven path. k > 0: the least effort near each of the first k starts that
            are proven, and of these the path of least energy; one that leads back to another is left out.
        beat: the least energy so far; a start that leads to no less is not economised to the end.

    Returns:
        PROVEN or REFUTED (not found); (4, σ+1); (3, τ+1) [m], highest power first; facts (7,), see `NUMBER`.
    """
    constraints = held(constraints)
    ell, proven = constraints.ell, 0
    family = held(path_family(ends, degrees[0], degrees[1]))
    end_least, floor = end_values(constraints, family), path_energy(family, ell, np.zeros(unknowns(family)))
    facts = np.array([0.0, 0.5, math.inf, math.inf, floor, -math.inf, 0.0])
    least, until = np.empty_like(end_least), window[1] if smallest(end_least) >= 0.0 else window[0] + 1
    rotation, translation = np.empty((4, 0)), np.empty((3, 0))
    optima, last, known = np.empty((0, 0)), -1, 0
    for number in range(window[0], until):
        facts[TRIED] = number + 1
        degree, start = scheduled(ends, degrees, number)
        if degree != last:
            family, last = held(path_family(ends, min(degree, degrees[0]), min(degree, degrees[1]))), degree
            optima, known = np.empty((economised, unknowns(family))), 0
        x = start_offsets(family, ell, start, phase)
        status, turn, move, w = settle(constraints, family, end_least, PULL, x, least)
        if status != PROVEN:
            if proven == 0 and smallest(least) >= facts[WORST]:
                rotation, translation = turn, move
                facts[NUMBER], facts[FAILED_AT], facts[WORST] = number, w, smallest(least)
            continue
        proven += 1
        found = energy = path_energy(family, ell, x)
        if economised > 0 and x.shape[0] > 0 and not leads_back(constraints, family, x, optima[:known]):
            status, better_turn, better_move, energy = economise(
                constraints, family, end_least, x, min(beat, facts[ENERGY])
            )
            if status == PROVEN:
                write(x, optima[known])
                turn, move, known = better_turn, better_move, known + 1
        if proven == 1 or energy < facts[ENERGY]:
            rotation, translation = turn, move
            facts[NUMBER], facts[FOUND], facts[ENERGY], facts[WORST] = number, found, energy, smallest(least)
        if proven >= economised or facts[ENERGY] <= floor:
            break
    return PROVEN if proven > 0 else REFUTED, rotation, translation, facts
