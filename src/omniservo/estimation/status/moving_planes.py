"""Whether a part of the matches that is nearly a plane moves by itself, though one motion bends to all.

A pattern of which some places are matched one period off: those agree with a homography, to what relief it
has, and so do the others. A homography says two things of each match where a motion says one, and so gathers
its matches however a motion bends to them: nothing is chosen by the distance from an epipolar line. That a
static plane has a homography, too, is no evidence. But then one motion explains it and the rest as well as
two do, which have `MORE` parameters more:

    F = (S_one − S_two)/MORE / (S_two/freedom),    χ² where noise is stated

Matches that two motions explain and one does not count as if they lay at the gate of the one.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from functools import lru_cache
from typing import NamedTuple

import numpy as np
from scipy.special import chdtrc, fdtrc

from omniservo.estimation.matches import Matches
from omniservo.estimation.refinement.epipolar_refinement import essential_matrix
from omniservo.estimation.refinement.motion_search import LEAST_NOISE_PX
from omniservo.estimation.robust.members import GATE, MOTION_PARAMETERS, mark_members
from omniservo.estimation.robust.two_view_fit import EIGHT_POINTS, NEARLY_ALL, TwoViewFit, fit_members
from omniservo.estimation.status.degenerate_motion import (
    HOMOGRAPHY,
    algebraic_map,
    map_distances,
    refine_linear_map,
)
from omniservo.estimation.status.evidence import is_one_answer
from omniservo.geometry.arrays import BoolArray, FloatArray, IntArray

MORE = MOTION_PARAMETERS
CHANCE = 3e-3
"""that one motion is taken for two, at most"""
DOUBTFUL = 0.05
"""likewise, below which the one is doubted: it stands, but its law holds what the rest alone says; only where
nearly all matches agree with it, since a plane gathers wrong ones, too"""
GATES = (2.0, 3.0, 4.5)
"""[px] or, where noise is stated, `STATED` σ times that: matches nearer than that to a homography are its
own. Relief is to stay within, and noise that chooses among them would make their rest too small."""
STATED = 2.0
LEAST = 6
"""Matches of a homography that say something about it"""
LEAST_SHARE = 0.15
LEAST_REST = 0.25
"""of the matches must agree with the rest's motion: a few, left over, agree with one that is chance's"""
EXPECTED = 0.05
"""What one motion leaves is nothing to explain where chance leaves more of what is stated by this;"""
SHARP_PX = 0.2
"""or where nothing is stated, and it leaves less than this."""
SAMPLES = 600
SAMPLE = 4
MOST_MATCHES = 3000
"""Among so many, drawn from all where there are more, homographies are looked for."""
ROUNDS = 3
"""So many homographies are looked for, each among what the last ones left; so often is each refined."""
STEPS = 8


class Bent(NamedTuple):
    """What parts of the matches that are nearly a plane say of the one motion."""

    instead: tuple[TwoViewFit, BoolArray] | None
    """the fit to the rest, another answer, and the plane (n,) that moves by itself; None: one will do"""
    doubts: list[TwoViewFit]
    """fits to the rest where two motions are likelier than one, but chance may bring it"""


def bent_to_plane(matches: Matches, fit: TwoViewFit, kind: int, error_px: float) -> Bent:
    """Return whether one motion bends to a plane that moves by itself, or may.

    Args:
        matches: all of them.
        fit: a pose, as far as its members tell.
        kind: of the rotation's parameters.
        error_px: standard deviation of the camera's model error [px].
    """
    if matches.size < 2 * EIGHT_POINTS or _is_expected(matches, fit, error_px):
        return Bent(None, [])
    least = max(LEAST, math.ceil(LEAST_SHARE * matches.size))
    best, chance, sampled = None, CHANCE, SampledMaps.of(matches)
    doubts, judged = [], set()
    for gate in GATES:
        for plane, cost in flat_groups(matches, sampled, gate * max(1.0, STATED * matches.noise_px), least):
            if (key := plane.tobytes()) in judged:
                continue
            judged.add(key)
            rest = _rest(matches, fit, kind, ~plane)
            if rest is None or rest.members.sum() < LEAST_REST * matches.size:
                continue
            here = _chance(matches, fit, rest, plane, _own_costs(matches, plane, kind, cost), error_px)
            if here < DOUBTFUL and fit.members.sum() >= NEARLY_ALL * matches.size:
                doubts.append(rest)
            if here < chance and not is_one_answer(fit.minima[0], rest.minima[0]):
                best, chance = (rest, plane), here
    return Bent(best, doubts)


def _is_expected(matches: Matches, fit: TwoViewFit, error_px: float) -> bool:
    """Tell whether one motion leaves no more than what is stated, or than the sharpest pixels have."""
    freedom = int(fit.members.sum()) - MOTION_PARAMETERS
    if matches.noise_px > 0.0:
        stated = matches.noise_px**2 + error_px**2
        return bool(chdtrc(freedom, fit.cost / stated) > EXPECTED)
    return fit.cost < freedom * SHARP_PX**2


class SampledMaps(NamedTuple):
    """Homographies of four matches each; the same every time."""

    maps: FloatArray
    """(s, 3, 3)"""
    judges: BoolArray
    """(n,) the m matches by which they are judged"""
    squares: FloatArray
    """(s, m) squared distances of these [px²]"""

    @classmethod
    def of(cls, matches: Matches) -> SampledMaps:
        """Return those of `SAMPLES` samples."""
        judges = _judges(matches.size)
        samples = np.flatnonzero(judges)[_samples(int(judges.sum()))]
        maps = _homographies(matches.bearings[samples, :3], matches.bearings[samples, 3:])
        return cls(maps, judges, squared_distances(matches.where(judges), maps))


def flat_groups(
    matches: Matches, sampled: SampledMaps, gate: float, least: int
) -> Iterator[tuple[BoolArray, float]]:
    """Yield groups (n,) of ``least`` and more within ``gate`` [px] of a homography, and its Σr² [px²].

    No match belongs to two.
    """
    left, distances = np.ones(matches.size, dtype=np.bool_), np.empty(matches.size)
    for _ in range(ROUNDS):
        squares = sampled.squares[:, left[sampled.judges]]
        best = int(np.argmin(np.minimum(squares, gate**2).sum(axis=1)))
        near = left & (squared_distances(matches, sampled.maps[best : best + 1])[0] < gate**2)
        cost = math.inf
        for _ in range(ROUNDS):
            if near.sum() < least:
                return
            chosen = matches.where(near)
            matrix = algebraic_map(chosen.bearings, np.ones(chosen.size, dtype=np.bool_), HOMOGRAPHY)
            cost = refine_linear_map(chosen, HOMOGRAPHY, math.inf, math.inf, STEPS, matrix)
            map_distances(matches, matrix, distances)
            before, near = near, left & (distances < gate)
            if np.array_equal(before, near):
                break
        yield before, cost
        left = left & ~before
        if left.sum() < least:
            return


def squared_distances(matches: Matches, maps: FloatArray) -> FloatArray:
    """Return squared distances (s, n) [px²] of all matches to homographies (s, 3, 3).

    With u = b ⊗ b* and v = b* ⊗ b*, b·G b* = g·u and ‖G b*‖² = (GᵀG)·v: two products of matrices.
    """
    initial, goal = matches.bearings[:, :3], matches.bearings[:, 3:]
    both = (initial[:, :, None] * goal[:, None, :]).reshape(-1, 9)
    own = (goal[:, :, None] * goal[:, None, :]).reshape(-1, 9)
    along = maps.reshape(-1, 9) @ both.T
    length = np.sqrt(np.maximum((maps.transpose(0, 2, 1) @ maps).reshape(-1, 9) @ own.T, 1e-300))
    square: FloatArray = 2.0 * (1.0 - along / length) / np.square(matches.jacobians[:, :6]).sum(axis=1)
    return square


@lru_cache(maxsize=32)
def _judges(size: int) -> BoolArray:
    """Return which of ``size`` matches homographies are made of, and judged by (n,)."""
    judges = np.random.default_rng(2).permutation(size) < MOST_MATCHES
    judges.setflags(write=False)
    return judges


@lru_cache(maxsize=32)
def _samples(size: int) -> IntArray:
    """Return which four of ``size`` matches make each homography (s, 4)."""
    random = np.random.default_rng(1)
    samples = np.argpartition(random.random((SAMPLES, size)), SAMPLE - 1)[:, :SAMPLE]
    samples.setflags(write=False)
    return samples


def _homographies(initial: FloatArray, goal: FloatArray) -> FloatArray:
    """Return the G (s, 3, 3) with G b* ∝ b for four bearings each (s, 4, 3); zero where they have none.

    With the first three as columns, B and B*, G = B diag(β/α) B*⁻¹ for α = B*⁻¹ b₄*, β = B⁻¹ b₄.
    """
    first, second = initial[:, :3].transpose(0, 2, 1), goal[:, :3].transpose(0, 2, 1)
    good = np.minimum(np.abs(np.linalg.det(first)), np.abs(np.linalg.det(second))) > 1e-9
    maps = np.zeros((len(initial), 3, 3))
    first, second = first[good], second[good]
    inverse = np.linalg.inv(second)
    alpha = np.einsum("sij,sj->si", inverse, goal[good, 3])
    beta = np.einsum("sij,sj->si", np.linalg.inv(first), initial[good, 3])
    ratio = np.where(alpha * beta > 0.0, beta / np.where(alpha == 0.0, 1.0, alpha), 0.0)
    ratio[~(ratio > 0.0).all(axis=1)] = 0.0
    maps[good] = first @ (ratio[:, :, None] * inverse)
    return maps


def _rest(matches: Matches, fit: TwoViewFit, kind: int, rest: BoolArray) -> TwoViewFit | None:
    """Return the fit to those of the rest that agree with each other, beginning with members of ``fit``."""
    members, essential = fit.members & rest, np.empty((3, 3))
    prior = fit.minima[0]
    for _ in range(2):
        if members.sum() < EIGHT_POINTS:
            return None
        essential_matrix(prior.rotation, prior.translation, essential)
        found = fit_members(matches, members, kind, essential, sampled=True)
        if not found.minima:
            return None
        prior = found.minima[0]
        members = members.copy()
        mark_members(matches, prior.rotation, prior.translation, GATE, members)
        members &= rest
        if np.array_equal(members, found.members):
            break
    return found


def _own_costs(matches: Matches, plane: BoolArray, kind: int, flat: float) -> list[tuple[float, int]]:
    """Return what a homography, and a motion, leave of a plane [px²], with their degrees of freedom."""
    count = int(plane.sum())
    costs = [(flat, 2 * count - 8)]
    if count >= EIGHT_POINTS:
        own = fit_members(matches, plane, kind, None, sampled=True)
        costs.append((own.cost, count - MOTION_PARAMETERS))
    return costs


def _chance(
    matches: Matches,
    fit: TwoViewFit,
    rest: TwoViewFit,
    plane: BoolArray,
    own: list[tuple[float, int]],
    error_px: float,
) -> float:
    """Return by what chance two motions explain so much more than one does."""
    inside, kept = int(fit.members.sum()), int(rest.members.sum())
    gained = kept + int(plane.sum()) - inside
    if gained < 0 or not rest.minima:
        return 1.0
    alone = fit.cost / (inside - MOTION_PARAMETERS)
    extra, stated, least = MORE + gained, matches.noise_px, 1.0
    for cost, freedom in own:
        two, left = rest.cost + cost, kept - MOTION_PARAMETERS + freedom
        if left < 1 or not two < math.inf:
            continue
        variance = max(two / left, stated**2, LEAST_NOISE_PX**2) + error_px**2
        gain = max(fit.cost + gained * GATE**2 * alone - two, 0.0) / variance
        least = min(least, float(chdtrc(extra, gain) if stated > 0.0 else fdtrc(extra, left, gain / extra)))
    return least
