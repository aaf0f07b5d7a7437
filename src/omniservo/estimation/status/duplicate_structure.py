"""Whether a structure that repeats was matched to what only looks like it.

A pattern that is matched some periods off, and a symmetric body that is matched to its turned self, are
rigid: their motion (R, t) leaves no noise, and is not the camera's. Matches of a background that contradict
it are left out. Any five agree with some motions (R', t'), which says nothing; but one that takes the
structure X of the inliers onto itself,

    R'ᵀ(X_i − λt') ∥ b_j*,  j ≠ i,

for at least `SHARE` of the points, explains them as well: each was matched to its double. A point is at the
place of another within `NEAR` of the distance between neighbours. Of n points, each there with the chance p
of a random direction, so many must be unlikely: P(K ≥ k) of B(n, p), times the motions tried, below `CHANCE`.
Duplicate structures: Roberts, Sinha, Szeliski and Steedly, CVPR 2011.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import NamedTuple

import numpy as np
from scipy.spatial import KDTree
from scipy.special import bdtrc

from omniservo.estimation.matches import Matches
from omniservo.estimation.minimal_solvers.essential_matrix import linear_structure, motion_in_front
from omniservo.estimation.minimal_solvers.five_points import MOST_SOLUTIONS, SAMPLE, five_point_essentials
from omniservo.estimation.refinement.motion_search import Minimum
from omniservo.estimation.robust.two_view_fit import TwoViewFit
from omniservo.geometry.arrays import FloatArray, IntArray

NEAR = 0.25
"""of the distance between a point and its nearest neighbour: seen at that one's place"""
SHARE = 0.5
"""Where fewer have another's place, the others tell which motion is the camera's."""
CHANCE = 1e-3
"""that any of the motions tried takes so many points onto others"""
SAMPLES = 20
SEEDS = 5
"""points by which the length of t' is tried"""
MOST_POINTS = 60
"""of the inliers are checked"""


class Duplicate(NamedTuple):
    """A motion under which inliers are seen where others are."""

    motion: Minimum
    doubles: int
    """points that are seen where others are"""
    checked: int
    """points checked"""


class _Places(NamedTuple):
    """The structure of the inliers, and where the goal view sees it."""

    points: FloatArray
    """(m, 3), initial camera frame, in lengths of the translation"""
    own: IntArray
    """(m,) index of a point's own direction"""
    directions: FloatArray
    """(n, 3) goal camera frame, unit length"""
    near: FloatArray
    """(n,) cosines above which a direction is at the place of this one"""
    chance: float
    """that a random direction among them is at the place of one"""

    @classmethod
    def of(cls, bearings: FloatArray, best: Minimum) -> _Places:
        directions, points = np.ascontiguousarray(bearings[:, 3:]), np.empty((len(bearings), 3))
        linear_structure(bearings, best.rotation, best.translation, points)
        chords = NEAR * np.asarray(KDTree(directions).query(directions, k=2)[0])[:, 1]
        spread = np.linalg.svd(directions - directions.mean(axis=0), compute_uv=False)[:2]
        area = 4.0 * math.pi * max(float(spread.prod()) / len(directions), 1e-12)  # of an even ellipse
        own = np.arange(0, len(points), math.ceil(len(points) / MOST_POINTS))
        chance = min(1.0, math.pi * float(np.square(chords).sum()) / area)
        return cls(points[own], own, directions, 1.0 - 0.5 * np.square(chords), chance)

    def lengths(self, rotation: FloatArray, translation: FloatArray) -> FloatArray:
        """Return the λ (s,) > 0 with which most of the middle points have another's place."""
        middle = np.argsort(-self.directions[self.own] @ self.directions.mean(axis=0))[:SEEDS]
        turned, along = self.points[middle] @ rotation, translation @ rotation
        depths, shifts, far = turned @ self.directions.T, self.directions @ along, (turned @ along)[:, None]
        lengths = (far - depths * shifts) / np.maximum(1.0 - shifts**2, 1e-12)  # nearest to each direction
        squares = np.square(turned).sum(axis=1)[:, None] - 2.0 * lengths * far + lengths**2
        cosines = (depths - lengths * shifts) / np.sqrt(np.maximum(squares, 1e-300))
        lengths = lengths[(cosines > self.near) & (lengths > 0.0)]
        taken = self.taken(rotation, lengths[:, None] * translation, middle) >= 0
        chosen: FloatArray = lengths[taken.sum(axis=1) > SHARE * SEEDS]
        return chosen

    def taken(self, rotation: FloatArray, translations: FloatArray, chosen: IntArray) -> IntArray:
        """Return whose place each chosen point has (s, c), −1 for none but its own, under s motions."""
        seen = (self.points[chosen] - translations[:, None]) @ rotation
        cosines = seen @ self.directions.T / np.maximum(np.linalg.norm(seen, axis=2), 1e-300)[:, :, None]
        other = cosines.argmax(axis=2)
        found: IntArray = np.where(
            (cosines.max(axis=2) > self.near[other]) & (other != self.own[chosen]), other, -1
        )
        return found


def duplicate_structure(matches: Matches, fit: TwoViewFit) -> Duplicate | None:
    """Return the motion of matches left out that takes the inliers' structure onto itself, if any does."""
    left = matches.where(~fit.members)
    if left.size < SAMPLE or fit.members.all():
        return None
    places = _Places.of(matches.bearings[fit.members], fit.minima[0])
    tried, best, most, everything = 0, None, 0, np.arange(len(places.own))
    for motion in _motions(left.bearings):
        for length in places.lengths(motion.rotation, motion.translation):
            tried += 1
            taken = places.taken(motion.rotation, length * motion.translation[None], everything)
            count = len(np.unique(taken[taken >= 0]))
            if count > most:
                most, best = count, motion
    checked = len(places.own)
    if best is None or most < SHARE * checked:
        return None
    by_chance = tried * float(bdtrc(most - 1, checked, places.chance))
    return Duplicate(best, most, checked) if by_chance < CHANCE else None


def _motions(bearings: FloatArray) -> Iterator[Minimum]:
    """Yield the motions that samples of five matches (n, 6) obey, all five in front of both cameras."""
    essentials, rng = np.empty((MOST_SOLUTIONS, 3, 3)), np.random.default_rng(0)
    everything = np.arange(SAMPLE)
    for _ in range(SAMPLES if len(bearings) > SAMPLE else 1):
        five = bearings[rng.choice(len(bearings), SAMPLE, replace=False)]
        for essential in essentials[: five_point_essentials(five, everything, essentials)]:
            rotation, translation, points = np.empty((3, 3)), np.empty(3), np.empty((SAMPLE, 3))
            if motion_in_front(five, essential, rotation, translation) == SAMPLE:
                linear_structure(five, rotation, translation, points)
                yield Minimum(0.0, rotation, translation, points, True)
