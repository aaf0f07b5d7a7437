"""Motions that explain the members of a fit as well as its own, looked for where a plane nearly does.

Where a homography G ∝ R + t mᵀ leaves little more than the motion does, the motion rests on little relief
or little parallax, and its cost has more than one minimum: that of the plane's other motion, and others with
much the same rotation in another direction. Eight-point solutions of the members, of which many matches have
one, do not lead to all of them.
"""

from __future__ import annotations

import itertools

import numpy as np

from omniservo.estimation.matches import Matches
from omniservo.estimation.refinement.epipolar_refinement import essential_matrix
from omniservo.estimation.refinement.motion_search import (
    HOPELESS,
    LEAST_NOISE_PX,
    START_ANGLES,
    eight_point_starts,
    search_motion,
)
from omniservo.estimation.refinement.planar_motion import decompose_homography
from omniservo.estimation.robust.members import GATE, mark_members
from omniservo.estimation.robust.two_view_fit import EIGHT_POINTS, TwoViewFit
from omniservo.estimation.status.degenerate_motion import (
    HOMOGRAPHY,
    MOST_STEPS,
    ROTATION,
    algebraic_map,
    refine_linear_map,
    simpler_costs,
)
from omniservo.geometry.arrays import FloatArray

_LATTICE = np.array([d for d in itertools.product((-1.0, 0.0, 1.0), repeat=3) if d > (0.0, 0.0, 0.0)])
DIRECTIONS = _LATTICE / np.linalg.norm(_LATTICE, axis=1, keepdims=True)
"""(13, 3) one of each pair of opposite ones, about 45° apart; which of a pair, the points in front decide"""


def with_rivals(matches: Matches, fit: TwoViewFit, kind: int, robust: bool) -> TwoViewFit:
    """Return the fit with all minima that a plane hides; robust: to the members of the best of them."""
    chosen = matches.where(fit.members)
    if chosen.size < EIGHT_POINTS or not fit.minima:
        return fit
    most = HOPELESS * max(fit.cost, LEAST_NOISE_PX**2 * chosen.size)
    if not simpler_costs(chosen, np.full(3, most))[HOMOGRAPHY] < most:
        return fit
    starts = np.concatenate((_essentials(_motions_of(fit)), _starts(chosen, most)))
    found = TwoViewFit(fit.members, search_motion(chosen, kind, starts), fit.instead)
    if not found.minima:
        return fit
    if robust:
        best, members = found.minima[0], fit.members.copy()
        count, _ = mark_members(matches, best.rotation, best.translation, GATE, members)
        if count >= EIGHT_POINTS and not np.array_equal(members, fit.members):
            starts = np.concatenate((_essentials(_motions_of(found)), starts))
            found = TwoViewFit(members, search_motion(matches.where(members), kind, starts), fit.instead)
    return found if found.minima else fit


def _motions_of(fit: TwoViewFit) -> list[tuple[FloatArray, FloatArray]]:
    return [(m.rotation, m.translation) for m in fit.minima]


def _starts(members: Matches, most: float) -> FloatArray:
    """Return essential matrices (s, 3, 3): of eight points, of the plane, and of the rotation any way on."""
    everyone = np.ones(members.size, dtype=np.bool_)
    plane, turn = (algebraic_map(members.bearings, everyone, kind) for kind in (HOMOGRAPHY, ROTATION))
    refine_linear_map(members, HOMOGRAPHY, np.inf, most, MOST_STEPS, plane)
    motions = [(m.rotation, m.translation) for m in decompose_homography(plane, members.bearings[:, 3:])]
    motions += [(turn, direction) for direction in DIRECTIONS]
    return np.concatenate((eight_point_starts(members.bearings, START_ANGLES), _essentials(motions)))


def _essentials(motions: list[tuple[FloatArray, FloatArray]]) -> FloatArray:
    found = np.empty((len(motions), 3, 3))
    for (rotation, translation), essential in zip(motions, found, strict=True):
        essential_matrix(np.ascontiguousarray(rotation), np.ascontiguousarray(translation), essential)
    return found
