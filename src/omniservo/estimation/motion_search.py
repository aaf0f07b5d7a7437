"""From several starts to the best motion and its best rival.

With few points the cost has more than one minimum. The starts lie in the span of the two eigenvectors of
AᵀA with the smallest eigenvalues, E = cos a e₁ + sin a e₂. The motion of each is refined first, without
structure; those that stay apart are then refined jointly with their structure and compared.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from omniservo.estimation.epipolar_refinement import essential_matrix, refine_epipolar
from omniservo.estimation.essential_matrix import eight_point_span, linear_structure, motion_in_front
from omniservo.estimation.joint_refinement import refine_jointly
from omniservo.estimation.matches import Matches
from omniservo.geometry.arrays import FloatArray

START_ANGLES = (0.0, 0.6, -0.6, 1.2, -1.2)
"""a [rad]; five starts leave about 1% of nine-point scenes in a false minimum, one start 10 to 20%."""

EPIPOLAR_STEPS = 20
JOINT_STEPS = 200
"""Flat valleys at half a pixel of noise need them; otherwise five to ten are enough."""

APART = 0.05
"""Two motions are the same minimum if rotation and direction both differ by less than this [rad]."""

HOPELESS = 30.0
"""A start is dropped where its epipolar cost is this many times the best joint cost."""


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


def search_motion(matches: Matches, kind: int, starts: list[FloatArray]) -> list[Minimum]:
    """Return the minima that the essential matrices ``starts`` lead to, apart from each other, best first.

    ``kind`` is the parametrisation s_R of the joint refinement.
    """
    motions = [motion for start in starts if (motion := refined_motion(matches, start)) is not None]
    motions.sort(key=lambda motion: motion[0])
    minima: list[Minimum] = []
    for cost, rotation, translation in motions:
        if minima and cost > HOPELESS * minima[0].cost:
            break
        if any(_same(rotation, translation, found) for found in minima):
            continue
        found = _refined_jointly(matches, kind, rotation, translation)
        twins = [other for other in minima if _same(found.rotation, found.translation, other)]
        if math.isfinite(found.cost) and all(found.cost < other.cost for other in twins):
            minima = [other for other in minima if not any(other is twin for twin in twins)] + [found]
            minima.sort(key=lambda minimum: minimum.cost)
    return minima


def eight_point_starts(matches: Matches, angles: tuple[float, ...]) -> list[FloatArray]:
    """Return E = cos a e₁ + sin a e₂ (3, 3) for each angle [rad]; a = 0 is the eight-point solution."""
    first, second = eight_point_span(matches.bearings)
    return [math.cos(a) * first + math.sin(a) * second for a in angles]


def refined_motion(matches: Matches, start: FloatArray) -> tuple[float, FloatArray, FloatArray] | None:
    """Return (epipolar cost, R, t) that ``start`` leads to, with the signs that put the points in front."""
    rotation, translation, essential = np.empty((3, 3)), np.empty(3), np.empty((3, 3))
    if motion_in_front(matches.bearings, start, rotation, translation) < 0:
        return None
    cost, _ = refine_epipolar(
        matches.bearings, matches.jacobians, math.inf, rotation, translation, EPIPOLAR_STEPS
    )
    essential_matrix(rotation, translation, essential)
    motion_in_front(matches.bearings, essential, rotation, translation)
    return cost, rotation, translation


def _refined_jointly(matches: Matches, kind: int, rotation: FloatArray, translation: FloatArray) -> Minimum:
    points = np.empty((len(matches.pixels), 3))
    linear_structure(matches.bearings, rotation, translation, points)
    cost, converged = refine_jointly(
        matches.parameters,
        matches.pixels,
        matches.weights,
        kind,
        math.inf,
        rotation,
        translation,
        points,
        JOINT_STEPS,
    )
    return Minimum(cost, rotation, translation, points, converged)


def _same(rotation: FloatArray, translation: FloatArray, other: Minimum) -> bool:
    """Tell whether two motions belong to one minimum."""
    # ‖R − R'‖² = 8 sin²(angle/2), nearly 2·angle² for small angles.
    chord = rotation - other.rotation
    return bool(
        np.vdot(chord, chord) < 2.0 * APART**2 and np.vdot(translation, other.translation) > math.cos(APART)
    )
