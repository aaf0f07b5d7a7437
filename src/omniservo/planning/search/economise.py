"""From a proven path to the one of least effort nearby, proven again (method section 6)."""

import math

import numpy as np

from omniservo.geometry.arrays import FloatArray
from omniservo.geometry.held import held
from omniservo.geometry.kernel import inlined, kernel
from omniservo.geometry.subdivision import PROVEN, REFUTED
from omniservo.geometry.vectors import copy_into, fill, smallest, write
from omniservo.planning.constraints.constraints import Constraints
from omniservo.planning.constraints.push import ASLEEP
from omniservo.planning.search.descent import PLENTY, Room, room_for
from omniservo.planning.search.effort_steps import bend, step_to_least_effort
from omniservo.planning.search.path_family import (
    MAX_SAMPLES,
    PathFamily,
    add_sample,
    family_like,
    path_energy,
    set_uniform_samples,
)
from omniservo.planning.search.prove_path import prove_path
from omniservo.planning.search.settle import capped_targets, power_path
from omniservo.planning.search.worst_rows import LOOKED_AT, Looks, look_at_samples

SAMPLES, BETWEEN = 10, 33
"""Samples at first, and those that show where the path loses most between them, which is added."""

LOOSE, FINE = 1e-2, 1e-4
"""Steps end where the next would gain less than this part of the energy: at first, and with more samples."""

NOTABLY = 0.999
"""A path that is followed up gets below this part of the energy to beat."""

LOOKS, PARTS = 16, (0.25, 0.5, 0.75)
"""Samples, and the places between two paths, of the look at what lies between the one and the other."""

JUMPED, RETURNS = 0.05, 3
"""A path that violates something by more has jumped over it: back to where it came from, so often."""

LEFT = 5e-5
"""What the active constraints keep, dimensionless; more where a proof asks for it."""

APART = 2e-3
"""Samples are at least so far apart."""

MORE = 2.0
"""So many times more is kept after a proof that another sample does not help."""

ROUNDS, PATIENCE = 20, 10
"""Sets of samples at most; after so many, more is kept after every proof that fails."""

SHORTER, SHORTEST = 0.7, 0.1
"""Where the way to the least effort is not proven, the first part of it is tried next, down to the second."""


@kernel
def add_apart(family: PathFamily, w: float) -> bool:
    """Add a sample at w; False where there is no room, or one that is less than APART away."""
    for s in range(family.samples[0]):
        if abs(family.places[s] - w) < APART:
            return False
    return add_sample(family, w)


@inlined
def add_lows(
    constraints: Constraints,
    family: PathFamily,
    between: PathFamily,
    x: FloatArray,
    kept: FloatArray,
    room: Room,
    asleep: FloatArray,
) -> tuple[bool, float]:
    """Add samples where groups have their lowest places between samples, and less left than half of ``kept``.

    Tell whether there are any, and the lowest g of all. ``between`` has evenly spaced samples; a parabola
    through three of them shows the place. A group with plenty left is put to sleep in ``asleep`` (groups,).
    """
    count, added, bottom = between.samples[0], False, math.inf
    levels = np.empty((count, kept.shape[0]))
    fill(asleep, LOOKED_AT)
    look_at_samples(constraints, between, x, asleep, room, levels)
    for i in range(kept.shape[0]):
        lowest = math.inf
        for s in range(count):
            lowest = min(lowest, levels[s, i])
        bottom = min(bottom, lowest)
        if lowest > PLENTY:
            asleep[i] = ASLEEP
        for s in range(1, count - 1):
            before, low, after = levels[s - 1, i], levels[s, i], levels[s + 1, i]
            if low < kept[i] + 0.1 and low <= before and low <= after:
                curvature = before - 2.0 * low + after
                shift = 0.5 * (before - after) / curvature if curvature > 0.0 else 0.0
                if low - 0.25 * (before - after) * shift < 0.5 * kept[i]:
                    added = add_apart(family, (s + 1.0 + shift) / (count + 1.0)) or added
    return added, bottom


@kernel
def leads_back(constraints: Constraints, family: PathFamily, x: FloatArray, optima: FloatArray) -> bool:
    """Tell whether nothing seems to obstruct the straight line from the path x to one of ``optima`` (m, nx).

    Its least effort nearby is then taken for that one's. The samples of ``family`` are replaced.
    """
    set_uniform_samples(family, LOOKS)
    room = held(room_for(LOOKS, constraints.points.shape[0]))
    asleep, trial = np.empty(constraints.slots.total), np.empty_like(x)
    levels = np.empty((LOOKS, asleep.shape[0]))
    fill(asleep, LOOKED_AT)
    for i in range(optima.shape[0]):
        clear_way = True
        for part in PARTS:
            if clear_way:
                for k in range(x.shape[0]):
                    trial[k] = x[k] + part * (optima[i, k] - x[k])
                look_at_samples(constraints, family, trial, asleep, room, levels)
                for k in range(LOOKS):
                    clear_way = clear_way and smallest(levels[k]) >= 0.0
        if clear_way:
            return True
    return False


@inlined
def economise(
    constraints: Constraints, family: PathFamily, ends: FloatArray, x: FloatArray, beat: float
) -> tuple[int, FloatArray, FloatArray, float]:
    """Lower the bending energy of a proven path in place, as far as it stays proven.

    Args:
        constraints: the problem.
        family: where to move.
        ends: `settle.end_values`.
        x: offsets of a proven path; of the better path where status is PROVEN, else unchanged.
        beat: an energy (`path_energy`); x may be left alone where the least nearby is not below it.

    Returns:
        PROVEN or REFUTED (no better path was proven), φ and t by powers, and the energy at x.
    """
    ell, found = constraints.ell, x.copy()
    before = path_energy(family, ell, x)
    status, rotation, translation = _bend_and_prove(constraints, family, ends, x, beat)
    part = 1.0 if path_energy(family, ell, x) < beat else 0.0
    while status != PROVEN and part > SHORTEST:
        part *= SHORTER
        for i in range(x.shape[0]):
            x[i] = found[i] + part * (x[i] - found[i])
        rotation, translation = power_path(family, ell, x)
        status, _ = prove_path(constraints, rotation, translation)
    energy = path_energy(family, ell, x)
    if status == PROVEN and energy < before:
        return PROVEN, rotation, translation, energy
    write(found, x)
    return REFUTED, rotation, translation, before


@inlined
def _bend_and_prove(
    constraints: Constraints, family: PathFamily, ends: FloatArray, x: FloatArray, beat: float
) -> tuple[int, FloatArray, FloatArray]:
    """Step to the least effort at the samples, and again with more of them, until the path is proven.

    More samples leave no less effort: where a path is not below ``beat`` with some, x is left alone. A path
    that has jumped over something between samples starts again with samples there.
    """
    ell, size, left, beat = constraints.ell, x.shape[0], LEFT, NOTABLY * beat
    room = held(room_for(MAX_SAMPLES, constraints.points.shape[0]))
    normal, hessian = np.empty((size, size + 1)), np.empty((size, size))
    bend(family, x, np.empty(size), normal)
    asleep, found = np.empty_like(ends), x.copy()
    set_uniform_samples(family, SAMPLES)
    between = family_like(family, BETWEEN)
    status, fine, returns = REFUTED, math.inf, 0
    rotation, translation = power_path(family, ell, x)
    for done in range(ROUNDS):
        if fine == math.inf:
            fine = LOOSE
            write(found, x)
            copy_into(normal[:, :size], hessian)
            fill(asleep, LOOKED_AT)
        kept = capped_targets(ends, left)
        looks = Looks(constraints, family, room, kept, asleep)
        missing = step_to_least_effort(looks, hessian, x, fine, 0.5 * beat)
        if missing == math.inf or path_energy(family, ell, x) >= beat:
            write(found, x)
            break
        added, lowest = add_lows(constraints, family, between, x, kept, room, asleep)
        if max(missing, -lowest) > JUMPED:
            returns += 1
            if not added or returns > RETURNS:
                break
            fine = math.inf
            continue
        if added or fine > FINE:
            fine = FINE
            continue
        rotation, translation = power_path(family, ell, x)
        status, w = prove_path(constraints, rotation, translation)
        if status == PROVEN:
            break
        fill(asleep, LOOKED_AT)
        copy_into(normal[:, :size], hessian)
        if not (status == REFUTED and add_apart(family, w)) or done >= PATIENCE:
            left *= MORE
    return status, rotation, translation
