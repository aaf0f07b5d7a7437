"""The worst of every group of constraints at samples of a path: its value, and its slope in the unknowns.

Both come from the families' own pushes (`constraints.push`): a group that is pushed by next to nothing pushes
with its worst constraint alone.
"""

import math
from typing import NamedTuple

from omniservo.geometry.arrays import FloatArray
from omniservo.geometry.kernel import kernel
from omniservo.geometry.vectors import fill
from omniservo.planning.constraints.constraints import Constraints
from omniservo.planning.constraints.place import AT, place
from omniservo.planning.constraints.push import ASLEEP, Samples
from omniservo.planning.search.descent import Room, push_all
from omniservo.planning.search.path_family import PathFamily, path_controls

TOUCH = 1e-8
"""A group is pushed so little to learn its slope."""

LOOKED_AT = -math.inf
"""Target of a group that is checked and not pushed."""


class Looks(NamedTuple):
    """A problem, checked at the samples of its paths."""

    constraints: Constraints
    """the problem, held"""
    family: PathFamily
    """where a path may go, and the samples; held"""
    room: Room
    """for all samples, held"""
    kept: FloatArray
    """what is to be left of each group of constraints at least (groups,)"""
    asleep: FloatArray
    """see `look_at_samples` (groups,)"""


@kernel
def look_at_samples(
    constraints: Constraints,
    family: PathFamily,
    x: FloatArray,
    asleep: FloatArray,
    room: Room,
    levels: FloatArray,
) -> None:
    """Write the smallest g of every group at every sample of the path x into ``levels`` (samples, groups).

    ``asleep`` (groups,) is ASLEEP for groups to leave out, whose level is ∞, and LOOKED_AT for the others.
    """
    phi, t = path_controls(family, constraints.ell, x)
    for s in range(family.samples[0]):
        rb, tb = family.rotation_basis[s], family.translation_basis[s]
        place(phi, t, rb, tb, constraints.points, room.poses[s], room.camera_points[s], room.turns[s])
        room.poses[s, AT] = family.places[s]
        fill(levels[s], math.inf)
        _push_at(constraints, room, s, asleep, levels[s])


@kernel
def _push_at(constraints: Constraints, room: Room, s: int, targets: FloatArray, least: FloatArray) -> None:
    """Let every family push at sample s alone."""
    poses, points = room.poses[s : s + 1], room.camera_points[s : s + 1]
    push_all(
        constraints, Samples(poses, points, targets, least, room.systems[s : s + 1], room.costs[s : s + 1])
    )


@kernel
def slope_at(
    looks: Looks,
    s: int,
    group: int,
    level: float,
    quiet: FloatArray,
    least: FloatArray,
    row: FloatArray,
) -> None:
    """Write ∂g/∂x (nx,) of the worst constraint of a group at sample s, after `look_at_samples`.

    ``level`` is its g; ``quiet`` (groups,) is all ASLEEP; ``least`` is room for a number a group.
    """
    constraints, family, room = looks.constraints, looks.family, looks.room
    system, pose, turn = room.systems[s], room.poses[s], room.turns[s]
    for a in range(6):
        system[a, 6] = 0.0
    least[group] = math.inf
    quiet[group] = level + TOUCH
    _push_at(constraints, room, s, quiet, least)
    quiet[group] = ASLEEP
    ell, turns, moves = constraints.ell, family.rotation_form.shape[0], family.translation_form.shape[0]
    first_turn = family.rotation_basis.shape[1] - 1 - turns
    first_move = family.translation_basis.shape[1] - 1 - moves
    for c in range(7):
        total = 0.0
        for a in range(3):
            total += turn[a, c] * system[3 + a, 6] if c < 4 else ell * pose[3 * (c - 4) + a] * system[a, 6]
        total /= TOUCH
        for k in range(turns if c < 4 else 0):
            row[4 * k + c] = family.rotation_basis[s, first_turn + k] * total
        for k in range(moves if c >= 4 else 0):
            row[4 * turns + 3 * k + c - 4] = family.translation_basis[s, first_move + k] * total
