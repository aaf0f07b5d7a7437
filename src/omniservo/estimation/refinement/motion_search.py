"""From several starts to the best motion and its best rival.

With few points the cost has more than one minimum. The starts lie in the span of the two eigenvectors of
AᵀA with the smallest eigenvalues, E = cos a e₁ + sin a e₂. The motion of each is refined first, without
structure; those that stay apart are then refined jointly with their structure and compared.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from omniservo.estimation.matches import Matches
from omniservo.estimation.minimal_solvers.essential_matrix import (
    eight_point_span,
    linear_structure,
    motion_in_front,
    turn_in_front,
)
from omniservo.estimation.refinement.epipolar_refinement import (
    correct_bearings,
    essential_matrix,
    refine_epipolar,
)
from omniservo.estimation.refinement.joint_refinement import refine_jointly
from omniservo.geometry.arrays import BoolArray, FloatArray
from omniservo.geometry.kernel import kernel, leaf

START_ANGLES = np.array([0.0, 0.6, -0.6, 1.2, -1.2])
"""a [rad]; five starts leave about 1% of nine-point scenes in a false minimum, one start 10 to 20%."""

EARLY_STEPS = 4
"""Starts that lead to one minimum have met by then."""
EPIPOLAR_STEPS = 20
FIRST_STEPS = 8
JOINT_STEPS = 200
"""Flat valleys at half a pixel of noise need them; otherwise five are enough."""

WORTHWHILE = 2.0
"""A minimum that is still so many times above the best one after its first steps is left as it is."""

APART = 0.05
"""Two motions are the same minimum if rotation and direction both differ by less than this [rad]."""

HOPELESS = 30.0
"""A start is dropped where its epipolar cost is this many times the best joint cost."""
HOPELESS_OF_MANY = 5.0
"""likewise of more than `FEW_POINTS`: the more points, the nearer the two costs are to each other"""

FEW_POINTS = 40
"""Up to here five starts are worth their time; beyond, one finds the minimum, if it is that of all matches
and not of a sample."""

LEAST_NOISE_PX = 0.01
"""No pixel is known better: below, a cost is rounding, and a larger one not worse."""


@dataclass(frozen=True, eq=False)
class Minimum:
    """A minimum of the reprojection error."""

    cost: float
    """Σr² [px²]"""
    rotation: FloatArray
    """(3, 3) R of initial_T_goal"""
    translation: FloatArray
    """(3,) of length 1"""
    points: FloatArray
    """(n, 3), initial camera frame, in lengths of the translation"""
    converged: bool


class Minima(NamedTuple):
    """Room for one minimum from each start."""

    costs: FloatArray
    """(s,) [px²], infinite where a start led to none of its own"""
    rotations: FloatArray
    """(s, 3, 3)"""
    translations: FloatArray
    """(s, 3)"""
    points: FloatArray
    """(s, n, 3)"""
    converged: BoolArray
    """(s,)"""


def search_motion(matches: Matches, kind: int, starts: FloatArray) -> list[Minimum]:
    """Return the minima that the essential matrices (s, 3, 3) lead to, apart from each other, best first.

    ``kind`` is the parametrisation s_R of the joint refinement.
    """
    s, n = len(starts), matches.size
    found = Minima(
        np.empty(s), np.empty((s, 3, 3)), np.empty((s, 3)), np.empty((s, n, 3)), np.empty(s, dtype=np.bool_)
    )
    search_minima(matches, kind, starts, found)
    return [
        Minimum(
            float(found.costs[k]),
            found.rotations[k],
            found.translations[k],
            found.points[k],
            bool(found.converged[k]),
        )
        for k in np.argsort(found.costs)
        if found.costs[k] < math.inf
    ]


@kernel
def search_minima(matches: Matches, kind: int, starts: FloatArray, found: Minima) -> None:
    """Fill ``found``; see `search_motion`."""
    order = _refined_starts(matches, starts, found)
    essential, rays = np.empty((3, 3)), np.empty_like(matches.bearings)
    floor = LEAST_NOISE_PX**2 * matches.bearings.shape[0]
    best, hopeless = math.inf, HOPELESS_OF_MANY if matches.bearings.shape[0] > FEW_POINTS else HOPELESS
    for k in np.argsort(order):
        if not order[k] < math.inf or order[k] > hopeless * max(best, floor):
            break
        if _twin(found, k, math.inf) >= 0:
            continue
        essential_matrix(found.rotations[k], found.translations[k], essential)
        correct_bearings(matches.bearings, matches.jacobians, essential, rays)
        linear_structure(rays, found.rotations[k], found.translations[k], found.points[k])
        cost, converged = _joint(matches, kind, found, k, FIRST_STEPS)
        if not converged and cost < WORTHWHILE * max(best, floor):
            cost, converged = _joint(matches, kind, found, k, JOINT_STEPS)
        found.converged[k] = converged
        if _twin(found, k, cost) >= 0:
            continue
        twin = _twin(found, k, math.inf)
        while twin >= 0:
            found.costs[twin] = math.inf
            twin = _twin(found, k, math.inf)
        found.costs[k] = cost
        best = min(best, cost)


@kernel
def _refined_starts(matches: Matches, starts: FloatArray, found: Minima) -> FloatArray:
    """Write the motions that the starts lead to; return their costs, infinite without one of their own.

    Starts on the way to one minimum meet early; only the best of them goes on.
    """
    b, j, r, t = matches.bearings, matches.jacobians, found.rotations, found.translations
    order, done = np.empty(starts.shape[0]), found.converged
    for k in range(order.shape[0]):
        order[k], done[k] = refined_motion(b, j, starts[k], EARLY_STEPS, r[k], t[k])
        found.costs[k] = math.inf
    for k in np.argsort(order):
        if order[k] < math.inf and _twin(found, k, math.inf) >= 0:
            order[k] = math.inf
        found.costs[k] = order[k]
    for k in range(order.shape[0]):
        found.costs[k] = math.inf
        if order[k] < math.inf and not done[k]:
            order[k], _ = refine_epipolar(b, j, math.inf, r[k], t[k], EPIPOLAR_STEPS - EARLY_STEPS)
            turn_in_front(b, r[k], t[k])
    return order


@leaf
def _joint(matches: Matches, kind: int, found: Minima, k: int, most_steps: int) -> tuple[float, bool]:
    """Refine motion and structure of place ``k``; return (cost [px²], converged)."""
    return refine_jointly(
        matches.parameters,
        matches.pixels,
        matches.weights,
        kind,
        found.rotations[k],
        found.translations[k],
        found.points[k],
        most_steps,
    )


@leaf
def _twin(found: Minima, k: int, most: float) -> int:
    """Return a minimum found before, of at most this cost, that the motion ``k`` belongs to; −1: none."""
    r, t = found.rotations, found.translations
    for other in range(found.costs.shape[0]):
        if other == k or not found.costs[other] < math.inf or found.costs[other] > most:
            continue
        # ‖R − R'‖² = 8 sin²(angle/2), nearly 2·angle² for small angles.
        chord, along = 0.0, 0.0
        for i in range(3):
            along += t[k, i] * t[other, i]
            for c in range(3):
                chord += (r[k, i, c] - r[other, i, c]) ** 2
        if chord < 2.0 * APART**2 and along > math.cos(APART):
            return other
    return -1


@kernel
def eight_point_starts(bearings: FloatArray, angles: FloatArray) -> FloatArray:
    """Return E = cos a e₁ + sin a e₂ (s, 3, 3) for each angle [rad]; a = 0 is the eight-point solution."""
    span, starts = np.empty((2, 3, 3)), np.empty((angles.shape[0], 3, 3))
    eight_point_span(bearings, np.ones(bearings.shape[0]), span)
    for k in range(angles.shape[0]):
        for i in range(9):
            starts[k, i // 3, i % 3] = (
                math.cos(angles[k]) * span[0, i // 3, i % 3] + math.sin(angles[k]) * span[1, i // 3, i % 3]
            )
    return starts


@leaf
def refined_motion(
    bearings: FloatArray,
    jacobians: FloatArray,
    start: FloatArray,
    most_steps: int,
    rotation: FloatArray,
    translation: FloatArray,
) -> tuple[float, bool]:
    """Write (R, t) that ``start`` leads to, the points in front; return its epipolar cost [px²], converged.

    Infinite where ``start`` has no motion.
    """
    if motion_in_front(bearings, start, rotation, translation) < 0:
        return math.inf, False
    cost, converged = refine_epipolar(bearings, jacobians, math.inf, rotation, translation, most_steps)
    turn_in_front(bearings, rotation, translation)
    return cost, converged
