"""Levenberg–Marquardt on squared hinges at samples: from a path to one that keeps its targets there.

Unknowns x: the offsets of `path_family`. Cost: Σ max(0, μ − g)²/2 over samples and
constraints (`constraints.push`) + pull · (bending energy / ℓ²)/2.
"""

import math
from typing import NamedTuple

import numpy as np

from omniservo.geometry.arrays import FloatArray
from omniservo.geometry.held import held
from omniservo.geometry.kernel import inlined, kernel, leaf
from omniservo.geometry.vectors import fill
from omniservo.planning.constraints.cloud import push_off_clouds
from omniservo.planning.constraints.cloud_sight import push_sights_off_clouds
from omniservo.planning.constraints.collision import push_from_obstacles
from omniservo.planning.constraints.constraints import Constraints
from omniservo.planning.constraints.free_side import push_to_free_side
from omniservo.planning.constraints.image_mask import push_off_masks
from omniservo.planning.constraints.least_distance import push_from_points
from omniservo.planning.constraints.occlusion import push_sights
from omniservo.planning.constraints.place import AT, place
from omniservo.planning.constraints.push import ASLEEP, Samples
from omniservo.planning.constraints.separation import push_off_bodies
from omniservo.planning.constraints.visibility import push_into_image, push_off_disc
from omniservo.planning.constraints.workspace import push_into_box
from omniservo.planning.search.path_family import PathFamily, path_controls

STALLED = 1e-3
"""Relative gain of a step below which a descent ends."""

ENOUGH = 0.5
"""The part of the targets at which a descent stops."""

DAMPING = 1e-6
"""of the first step of a descent"""

PLENTY = 0.4
"""A group with more left at the start of a descent sleeps through it; the proof looks at it again."""


RIGHT = 7
"""the column of the right side in a sample's block, beside those of φ and t"""


class Room(NamedTuple):
    """Where `linearise` puts what it needs on its way."""

    poses: FloatArray
    """(samples, 14), see `push`"""
    turns: FloatArray
    """∂angular/∂φ (samples, 3, 4)"""
    camera_points: FloatArray
    """c and 1/‖c‖ (samples, n, 4)"""
    systems: FloatArray
    """(samples, 6, 7), see `push`"""
    costs: FloatArray
    """(samples,), see `push`"""
    block: FloatArray
    """see `spread`"""


@kernel
def room_for(samples: int, points: int) -> Room:
    """Return room for so many samples and target points."""
    return Room(
        np.empty((samples, 14)),
        np.empty((samples, 3, 4)),
        np.empty((samples, points, 4)),
        np.empty((samples, 6, 7)),
        np.empty(samples),
        np.empty((13, 8)),
    )


@inlined
def push_all(constraints: Constraints, samples: Samples) -> None:
    """Let every family push at all samples; those that a problem lacks are not even compiled."""
    ell, slots = constraints.ell, constraints.slots
    push_into_image(constraints.limits, samples, slots.limits)
    if constraints.disc.shape[0] > 0:
        push_off_disc(constraints, samples)
    push_from_points(constraints.points, constraints.least_distance, ell, samples, slots.least_distance)
    push_from_obstacles(constraints.obstacles, ell, samples, slots.obstacles)
    if constraints.occlusion and constraints.obstacles.shape[0] > 0:
        push_sights(constraints, samples)
    push_into_box(constraints.box, ell, samples, slots.walls)
    if constraints.bodies.shape[0] > 0:
        push_off_bodies(constraints, samples)
    if constraints.planes.shape[0] > 0:
        push_to_free_side(constraints, samples)
    if constraints.mask_edges.shape[0] > 0:
        push_off_masks(constraints, samples)
    if constraints.clouds.shape[0] > 0:
        push_off_clouds(constraints, samples)
        if constraints.occlusion:
            push_sights_off_clouds(constraints, samples)


@kernel
def spread(
    family: PathFamily,
    ell: float,
    index: int,
    system: FloatArray,
    pose: FloatArray,
    turn: FloatArray,
    room: FloatArray,
    normal: FloatArray,
) -> None:
    """Add one sample's system (6, 7) to the lower triangle and right side of the equations (nx, nx+1).

    With the columns (φ, t) of its Jacobian J = [0 ℓRᵀ; turn 0] the sample's part is Jᵀ S J, a block (7, 8).
    ``room`` (13, 8) holds S J and the block.
    """
    turns = system[3, 3] + system[4, 4] + system[5, 5] > 0.0
    for a in range(6 if turns else 3):
        for b in range(a):
            system[a, b] = system[b, a]
        for c in range(3):
            total = 0.0
            for b in range(3):
                total += system[a, b] * pose[3 * c + b]
            room[a, 4 + c] = ell * total
        for c in range(4 if turns else 0):
            total = 0.0
            for b in range(3):
                total += system[a, 3 + b] * turn[b, c]
            room[a, c] = total
        room[a, RIGHT] = system[a, 6]
    first = 0 if turns else 4
    for r in range(first, 7):
        for c in range(first, 8):
            total = 0.0
            for a in range(3):
                total += turn[a, r] * room[3 + a, c] if r < 4 else pose[3 * (r - 4) + a] * room[a, c]
            room[6 + r, c] = total if r < 4 else ell * total
    _add_blocks(family, index, 0 if turns else family.rotation_form.shape[0], room, normal)


@kernel
def _add_blocks(family: PathFamily, index: int, first: int, room: FloatArray, normal: FloatArray) -> None:
    """Spread a sample's block ``room[6:]`` over the inner controls from ``first`` on, lower triangle only."""
    inner = family.rotation_form.shape[0]
    last = normal.shape[1] - 1
    for i in range(first, inner + family.translation_form.shape[0]):
        top, rows, bi, row = _block(family, index, i, inner)
        for r in range(rows):
            normal[row + r, last] += bi * room[6 + top + r, RIGHT]
        for j in range(first, i + 1):
            left, columns, bj, column = _block(family, index, j, inner)
            f = bi * bj
            for r in range(rows):
                for c in range(columns):
                    normal[row + r, column + c] += f * room[6 + top + r, left + c]


@kernel
def _block(family: PathFamily, index: int, i: int, inner: int) -> tuple[int, int, float, int]:
    """Return row in the 7-block, height, basis value, row among the unknowns of free control i."""
    if i < inner:
        basis = family.rotation_basis
        return 0, 4, basis[index, basis.shape[1] - 1 - inner + i], 4 * i
    k, basis = i - inner, family.translation_basis
    free = family.translation_form.shape[0]
    return 4, 3, basis[index, basis.shape[1] - 1 - free + k], 4 * inner + 3 * k


@leaf
def clear(values: FloatArray) -> None:
    """Set every item of (m, n) to 0."""
    for i in range(values.shape[0]):
        for j in range(values.shape[1]):
            values[i, j] = 0.0


@kernel
def linearise(
    constraints: Constraints,
    family: PathFamily,
    x: FloatArray,
    targets: FloatArray,
    pull: float,
    room: Room,
    least: FloatArray,
    normal: FloatArray,
) -> float:
    """Return the cost at x; write ``least`` over the samples and the normal equations (nx, nx+1).

    Of their matrix only the lower triangle counts.
    """
    ell, count = constraints.ell, family.samples[0]
    phi, t = path_controls(family, ell, x)
    poses, turns, camera_points = room.poses[:count], room.turns, room.camera_points[:count]
    systems, costs = room.systems, room.costs
    fill(least, math.inf)
    clear(normal)
    for s in range(count):
        rb, tb = family.rotation_basis[s], family.translation_basis[s]
        place(phi, t, rb, tb, constraints.points, poses[s], camera_points[s], turns[s])
        poses[s, AT] = family.places[s]
        clear(systems[s])
        costs[s] = 0.0
    push_all(constraints, Samples(poses, camera_points, targets, least, systems[:count], costs[:count]))
    cost = add_bending(family, x, pull, normal)
    for s in range(count):
        if costs[s] > 0.0:
            cost += costs[s]
            spread(family, ell, s, systems[s], poses[s], turns[s], room.block, normal)
    return cost


@kernel
def add_bending(family: PathFamily, x: FloatArray, pull: float, normal: FloatArray) -> float:
    """Add pull · W to the normal matrix and −pull · W x to its right side; return pull · xᵀWx/2."""
    inner = family.rotation_form.shape[0]
    last = normal.shape[1] - 1
    cost = 0.0
    for i in range(inner + family.translation_form.shape[0]):
        rotation = i < inner
        form = family.rotation_form if rotation else family.translation_form
        size = 4 if rotation else 3
        base = 0 if rotation else 4 * inner
        a = i if rotation else i - inner
        for b in range(form.shape[0]):
            f = pull * form[a, b]
            for c in range(size):
                row, column = base + size * a + c, base + size * b + c
                normal[row, column] += f
                normal[row, last] -= f * x[column]
                cost += 0.5 * f * x[row] * x[column]
    return cost


@leaf
def solve_damped(normal: FloatArray, damping: float, factor: FloatArray, step: FloatArray) -> bool:
    """Solve (H + damping · (diag H + mean diag H)) step = b by Cholesky; False where H is not positive.

    ``normal`` is [H, b], its lower triangle; ``factor`` (nx, nx) is room.
    """
    n = normal.shape[0]
    mean = 0.0
    for i in range(n):
        mean += normal[i, i] / n
    for j in range(n):
        for i in range(j, n):
            total = normal[i, j]
            if i == j:
                total += damping * (normal[i, i] + mean) + 1e-14 * mean
            for k in range(j):
                total -= factor[i, k] * factor[j, k]
            if i == j:
                if not total > 0.0:
                    return False
                factor[j, j] = math.sqrt(total)
            else:
                factor[i, j] = total / factor[j, j]
    for i in range(n):
        total = normal[i, n]
        for k in range(i):
            total -= factor[i, k] * step[k]
        step[i] = total / factor[i, i]
    for i in range(n - 1, -1, -1):
        for k in range(i + 1, n):
            step[i] -= factor[k, i] * step[k]
        step[i] /= factor[i, i]
    return True


@inlined
def descend(
    constraints: Constraints,
    family: PathFamily,
    x: FloatArray,
    targets: FloatArray,
    pull: float,
    least: FloatArray,
) -> float:
    """Lower the cost from x in place; stop when g ≥ ENOUGH · target everywhere, or when it stalls.

    Writes the smallest g of every group at x into ``least``; returns the cost.
    """
    size = x.shape[0]
    normal, tried = np.empty((size, size + 1)), np.empty((size, size + 1))
    tried_least, factor = np.empty_like(least), np.empty((size, size))
    step, trial = np.empty(size), np.empty(size)
    room = held(room_for(family.samples[0], constraints.points.shape[0]))
    cost, damping = linearise(constraints, family, x, targets, pull, room, least, normal), DAMPING
    awake = np.empty_like(targets)
    for i in range(targets.shape[0]):
        awake[i] = ASLEEP if least[i] > PLENTY else targets[i]
    for _ in range(30):
        if reached(least, targets, ENOUGH) or size == 0:
            break
        if not solve_damped(normal, damping, factor, step):
            break
        for i in range(size):
            trial[i] = x[i] + step[i]
        tried_cost = linearise(constraints, family, trial, awake, pull, room, tried_least, tried)
        if tried_cost < cost:
            stalled = cost - tried_cost < STALLED * cost
            for i in range(size):
                x[i] = trial[i]
            normal, tried = tried, normal
            for i in range(least.shape[0]):
                if awake[i] != ASLEEP:
                    least[i] = tried_least[i]
            cost = tried_cost
            damping = max(0.2 * damping, 1e-9)
            if stalled:
                break
        else:
            damping = max(5.0 * damping, 1e-4)
            if damping > 1e4:
                break
    return cost


@leaf
def reached(least: FloatArray, targets: FloatArray, enough: float) -> bool:
    """Tell whether every group's smallest g is at least ``enough`` times its target."""
    holds = True
    for i in range(least.shape[0]):
        holds = holds and least[i] >= enough * targets[i]
    return holds
