"""Sequential quadratic programming: the least bending energy that keeps every constraint at the samples.

min E(x)/2 subject to g(x, w_k) ≥ kept for the worst constraint of every group at every sample. E is quadratic
in x; the curvature of the active constraints is gathered by damped BFGS updates of the Lagrangian's Hessian,
which begins as E's. An ℓ₁ merit function decides how far a step goes.
"""

import math
from typing import NamedTuple

import numpy as np

from omniservo.geometry.arrays import FloatArray, IntArray
from omniservo.geometry.kernel import inlined, kernel, leaf
from omniservo.geometry.quadratic_program import quadratic_step
from omniservo.planning.constraints.push import ASLEEP
from omniservo.planning.search.descent import add_bending, clear
from omniservo.planning.search.path_family import PathFamily
from omniservo.planning.search.worst_rows import Looks, look_at_samples, slope_at

STEPS = 30
"""Quadratic programs at most."""

MOST_ROWS = 60
"""Constraints of one quadratic program at most."""

BAND = 0.2
"""Constraints with more left than this are not in the quadratic program."""

FARTHER = 2.0
"""Steps end where so many times what the next one gains in energy would not be enough."""

ASTRAY = 1.0
"""A step adds no shortfall beyond this: the path would be on the wrong side of something."""

FLATTEST = 0.1
"""The Hessian's curvature along a step is at least this part of the energy's."""

STEEPEST = 5.0
"""A change that shows more than so many times the energy's curvature is that of another point, not learnt."""

HALVINGS = 8
"""A step is halved at most so often before the steps end."""


class Rows(NamedTuple):
    """Linearised constraints."""

    sample: IntArray
    """(MOST_ROWS,)"""
    group: IntArray
    """(MOST_ROWS,)"""
    slope: FloatArray
    """∂g/∂x (MOST_ROWS, nx)"""
    multiplier: FloatArray
    """(MOST_ROWS,)"""


class Promise(NamedTuple):
    """What a step of the path is judged by."""

    energy: float
    """half the bending energy where the step begins"""
    short: float
    """the `shortfall` there"""
    price: float
    """of one unit of shortfall in the merit"""
    gain: float
    """what the linearised problem promises of the merit for the whole step"""


@kernel
def rows_for(size: int) -> Rows:
    """Return room for the rows of nx unknowns."""
    return Rows(
        np.empty(MOST_ROWS, dtype=np.int64),
        np.empty(MOST_ROWS, dtype=np.int64),
        np.empty((MOST_ROWS, size)),
        np.zeros(MOST_ROWS),
    )


@leaf
def keep_active(rows: Rows, count: int) -> int:
    """Move the rows with a multiplier to the front; return how many."""
    active = 0
    for i in range(count):
        if rows.multiplier[i] > 0.0:
            rows.sample[active], rows.group[active] = rows.sample[i], rows.group[i]
            rows.multiplier[active] = rows.multiplier[i]
            for k in range(rows.slope.shape[1]):
                rows.slope[active, k] = rows.slope[i, k]
            active += 1
    return active


@leaf
def choose_rows(levels: FloatArray, samples: int, kept: FloatArray, rows: Rows, active: int) -> int:
    """Append every (sample, group) with less left than BAND to the ``active`` first ones; return how many."""
    count = active
    for i in range(levels.shape[1]):
        for s in range(samples):
            if levels[s, i] < kept[i] + BAND and count < MOST_ROWS:
                known = False
                for a in range(active):
                    known = known or (rows.sample[a] == s and rows.group[a] == i)
                if not known:
                    rows.sample[count], rows.group[count] = s, i
                    rows.multiplier[count] = 0.0
                    count += 1
    return count


@leaf
def shortfall(levels: FloatArray, samples: int, kept: FloatArray) -> float:
    """Return Σ max(0, kept − g) over samples and groups."""
    total = 0.0
    for s in range(samples):
        for i in range(kept.shape[0]):
            if levels[s, i] < kept[i]:
                total += kept[i] - levels[s, i]
    return total


@kernel
def update_hessian(hessian: FloatArray, step: FloatArray, change: FloatArray, least: float) -> None:
    """Add what ``change`` of the Lagrangian's gradient over ``step`` says (BFGS, Powell's damping).

    The curvature along the step becomes ``least`` at least.
    """
    n = step.shape[0]
    product = np.zeros(n)
    curved, seen = 0.0, 0.0
    for i in range(n):
        for k in range(n):
            product[i] += hessian[i, k] * step[k]
        curved += step[i] * product[i]
        seen += step[i] * change[i]
    if not curved > 0.0:
        return
    least = min(max(0.2 * curved, least), curved)
    part = 1.0 if seen >= least else (curved - least) / (curved - seen)
    mixed = part * seen + (1.0 - part) * curved
    for i in range(n):
        change[i] = part * change[i] + (1.0 - part) * product[i]
    for i in range(n):
        for k in range(n):
            hessian[i, k] += change[i] * change[k] / mixed - product[i] * product[k] / curved


@leaf
def add_constraint_slopes(rows: Rows, active: int, factor: float, change: FloatArray) -> None:
    """Add factor · Σ λ ∂g/∂x of the ``active`` first rows to ``change`` (nx,)."""
    for r in range(active):
        for i in range(change.shape[0]):
            change[i] += factor * rows.multiplier[r] * rows.slope[r, i]


@leaf
def dot(a: FloatArray, b: FloatArray) -> float:
    """Return Σ aᵢbᵢ."""
    total = 0.0
    for i in range(a.shape[0]):
        total += a[i] * b[i]
    return total


@kernel
def bend(family: PathFamily, x: FloatArray, gradient: FloatArray, normal: FloatArray) -> float:
    """Return E/2; write its gradient (nx,) and its Hessian into ``normal`` (nx, nx+1)."""
    clear(normal)
    energy = add_bending(family, x, 1.0, normal)
    for i in range(x.shape[0]):
        gradient[i] = -normal[i, x.shape[0]]
    return energy


@leaf
def price_of(multipliers: FloatArray, gradient: FloatArray) -> float:
    """Return what one unit of shortfall costs in the merit function: more than any multiplier."""
    price = math.sqrt(dot(gradient, gradient))
    for r in range(multipliers.shape[0]):
        price = max(price, 1.5 * multipliers[r])
    return price


@kernel
def linearise_rows(
    looks: Looks,
    levels: FloatArray,
    quiet: FloatArray,
    rows: Rows,
    count: int,
    right: FloatArray,
    scratch: FloatArray,
) -> None:
    """Write ∂g/∂x of the ``count`` first rows, and what each has to gain, kept − g, into ``right``.

    ``scratch`` is room for a number a group.
    """
    for r in range(count):
        s, group = rows.sample[r], rows.group[r]
        right[r] = looks.kept[group] - levels[s, group]
        slope_at(looks, s, group, levels[s, group], quiet, scratch, rows.slope[r])


@inlined
def learn_curvature(hessian: FloatArray, step: FloatArray, change: FloatArray, plain: float) -> None:
    """Update the Hessian by what the Lagrangian's gradient did along a step, the energy's ``plain``."""
    if dot(change, change) * dot(step, step) < (STEEPEST * plain) ** 2:
        update_hessian(hessian, step, change, FLATTEST * plain)


@inlined
def as_far_as_it_pays(
    looks: Looks,
    x: FloatArray,
    step: FloatArray,
    trial: FloatArray,
    levels: FloatArray,
    gradient: FloatArray,
    promise: Promise,
) -> tuple[float, float, float]:
    """Halve a step from x until the ℓ₁ merit falls by enough of what it promises.

    ``trial``, x + step at first, gets the place, ``levels`` and ``gradient`` what is there. Returns the part
    of the step, 0 where none will do, and half the energy and the shortfall there.
    """
    part, normal = 1.0, np.empty((x.shape[0], x.shape[0] + 1))
    for _ in range(HALVINGS):
        tried = bend(looks.family, trial, gradient, normal)
        look_at_samples(looks.constraints, looks.family, trial, looks.asleep, looks.room, levels)
        violated = shortfall(levels, levels.shape[0], looks.kept)
        merit = tried - promise.energy + promise.price * (violated - promise.short)
        if violated <= max(promise.short, ASTRAY) and merit <= -1e-4 * part * promise.gain:
            return part, tried, violated
        part *= 0.5
        for i in range(x.shape[0]):
            trial[i] = x[i] + part * step[i]
    return 0.0, promise.energy, promise.short


@inlined
def step_to_least_effort(looks: Looks, hessian: FloatArray, x: FloatArray, fine: float, beat: float) -> float:
    """Lower the energy from x in place, keeping what is to be kept at the samples.

    Args:
        looks: the problem, where to move, and the samples.
        hessian: of the Lagrangian (nx, nx), at first; with what the steps have learnt at the end.
        x: offsets (nx,).
        fine: the steps end where the next would gain less than this part of the energy.
        beat: half an energy; the steps end where they are not likely to get below it.

    Returns:
        Σ max(0, kept − g) at x; ∞ where the steps ended because of ``beat``.
    """
    family, kept = looks.family, looks.kept
    n, samples, active, plain = x.shape[0], family.samples[0], 0, 0.0
    gradient, whole, change, step, trial = np.empty(n), np.empty(n), np.zeros(n), np.zeros(n), np.empty(n)
    normal, rows, quiet = np.empty((n, n + 1)), rows_for(n), np.full(kept.shape[0], ASLEEP)
    levels, right, scratch = np.empty((samples, kept.shape[0])), np.empty(MOST_ROWS), np.empty_like(kept)
    look_at_samples(looks.constraints, family, x, looks.asleep, looks.room, levels)
    energy, short = bend(family, x, gradient, normal), shortfall(levels, samples, kept)
    for _ in range(STEPS):
        count = choose_rows(levels, samples, kept, rows, active)
        add_constraint_slopes(rows, active, 1.0, change)
        linearise_rows(looks, levels, quiet, rows, count, right, scratch)
        add_constraint_slopes(rows, active, -1.0, change)
        learn_curvature(hessian, step, change, plain)
        multipliers = rows.multiplier[:count]
        if not quadratic_step(hessian, gradient, rows.slope[:count], right[:count], step, multipliers):
            break
        price = price_of(multipliers, gradient)
        gain = price * short - dot(gradient, step)
        if not gain > fine * energy:
            break
        for i in range(n):
            change[i], trial[i] = -gradient[i], x[i] + step[i]
        if energy + FARTHER * (bend(family, trial, whole, normal) - energy) > beat:
            return math.inf
        promise = Promise(energy, short, price, gain)
        part, tried, violated = as_far_as_it_pays(looks, x, step, trial, levels, gradient, promise)
        if part == 0.0:
            break
        for i in range(n):
            x[i], step[i], change[i] = trial[i], part * step[i], change[i] + gradient[i]
        energy, short, active, plain = tried, violated, keep_active(rows, count), dot(change, step)
    return short
