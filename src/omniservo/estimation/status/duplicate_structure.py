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
from typing import NamedTuple

import numpy as np
from scipy.spatial import KDTree
from scipy.special import bdtrc

from omniservo.estimation.matches import Matches
from omniservo.estimation.minimal_solvers.essential_matrix import linear_structure, motion_in_front
from omniservo.estimation.minimal_solvers.five_points import MOST_SOLUTIONS, SAMPLE, five_point_essentials
from omniservo.estimation.refinement.motion_search import Minimum
from omniservo.estimation.robust.consensus import draw
from omniservo.estimation.robust.two_view_fit import TwoViewFit
from omniservo.geometry.arrays import BoolArray, FloatArray, IntArray
from omniservo.geometry.kernel import kernel, leaf

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
LARGEST = 4.0
"""times the median: the place of a point far from all others is no larger"""


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
    middle: IntArray
    """(s,) the points that are seen nearest to the mean direction"""
    directions: FloatArray
    """(n, 3) goal camera frame, unit length, in the order of x"""
    near: FloatArray
    """(n,) cosines above which a direction is at the place of this one"""
    reach: float
    """largest difference of x at a place"""
    chance: float
    """that a random direction among them is at the place of one"""


def _places(bearings: FloatArray, best: Minimum) -> _Places:
    ordered = bearings[np.argsort(bearings[:, 3])]
    directions, points = np.ascontiguousarray(ordered[:, 3:]), np.empty((len(ordered), 3))
    linear_structure(ordered, best.rotation, best.translation, points)
    chords = NEAR * np.asarray(KDTree(directions).query(directions, k=2)[0])[:, 1]
    chords = np.minimum(chords, LARGEST * np.median(chords))
    spread = np.linalg.svd(directions - directions.mean(axis=0), compute_uv=False)[:2]
    area = 4.0 * math.pi * max(float(spread.prod()) / len(directions), 1e-12)  # of an even ellipse
    own = np.arange(0, len(points), math.ceil(len(points) / MOST_POINTS))
    middle = np.argsort(-directions[own] @ directions.mean(axis=0))[:SEEDS]
    chance = min(1.0, math.pi * float(np.square(chords).sum()) / area)
    near, reach = 1.0 - 0.5 * np.square(chords), float(chords.max())
    return _Places(points[own], own, middle, directions, near, reach, chance)


def duplicate_structure(matches: Matches, fit: TwoViewFit) -> Duplicate | None:
    """Return the motion of matches left out that takes the inliers' structure onto itself, if any does."""
    left = matches.where(~fit.members).bearings
    if len(left) < SAMPLE or fit.members.all():
        return None
    places = _places(matches.bearings[fit.members], fit.minima[0])
    rotation, translation, five = np.empty((3, 3)), np.empty(3), np.empty(SAMPLE, dtype=np.int64)
    tried, doubles = _most_doubles(left, places, rotation, translation, five)
    checked = len(places.own)
    if doubles < SHARE * checked or tried * float(bdtrc(doubles - 1, checked, places.chance)) >= CHANCE:
        return None
    points = np.empty((SAMPLE, 3))
    linear_structure(left[five], rotation, translation, points)
    return Duplicate(Minimum(0.0, rotation, translation, points, True), doubles, checked)


@kernel
def _most_doubles(
    left: FloatArray, places: _Places, rotation: FloatArray, translation: FloatArray, five: IntArray
) -> tuple[int, int]:
    """Write the motion of five of the matches (k, 6) under which most points have another's place.

    Returns how many motions (R', λt') were tried, and how many places are taken under that one.
    """
    essentials, R, t = np.empty((MOST_SOLUTIONS, 3, 3)), np.empty((3, 3)), np.empty(3)
    chosen, is_taken = np.empty(SAMPLE, dtype=np.int64), np.empty(len(places.near), dtype=np.bool_)
    tried, most, state = 0, 0, 1
    for _ in range(SAMPLES if len(left) > SAMPLE else 1):
        state = draw(state, len(left), chosen)
        for k in range(five_point_essentials(left, chosen, essentials)):
            if motion_in_front(left[chosen], essentials[k], R, t) < SAMPLE:
                continue
            for i in places.middle:
                for j in range(len(places.near)):
                    length = _length(places, i, j, R, t)
                    if not length > 0.0 or not _suits_the_middle(places, R, t, length):
                        continue
                    tried += 1
                    doubles = _doubles(places, R, t, length, is_taken)
                    if doubles > most:
                        most = doubles
                        rotation[:], translation[:], five[:] = R, t, chosen
    return tried, most


@leaf
def _length(places: _Places, i: int, j: int, R: FloatArray, t: FloatArray) -> float:
    """Return the λ with which point i is seen nearest to direction j; −1 where that is not at its place."""
    depth, shift, far, square = 0.0, 0.0, 0.0, 0.0
    for a in range(3):
        turned, along = 0.0, 0.0
        for b in range(3):
            turned += places.points[i, b] * R[b, a]
            along += t[b] * R[b, a]
        depth += turned * places.directions[j, a]
        shift += along * places.directions[j, a]
        far += turned * along
        square += turned * turned
    length = (far - depth * shift) / max(1.0 - shift * shift, 1e-12)
    distance = math.sqrt(max(square - 2.0 * length * far + length * length, 1e-300))
    return length if depth - length * shift > places.near[j] * distance else -1.0


@leaf
def _suits_the_middle(places: _Places, R: FloatArray, t: FloatArray, length: float) -> bool:
    """Tell whether most of the middle points have another's place."""
    count = 0
    for i in places.middle:
        if _taken(places, i, R, t, length) >= 0:
            count += 1
    return count > SHARE * SEEDS


@leaf
def _doubles(places: _Places, R: FloatArray, t: FloatArray, length: float, is_taken: BoolArray) -> int:
    """Return how many places are taken by other points than their own."""
    count = 0
    is_taken[:] = False
    for i in range(len(places.own)):
        j = _taken(places, i, R, t, length)
        if j >= 0 and not is_taken[j]:
            is_taken[j] = True
            count += 1
    return count


@leaf
def _taken(places: _Places, i: int, R: FloatArray, t: FloatArray, length: float) -> int:
    """Return whose place point i has, −1: none but its own. No direction is at two places."""
    seen = (0.0, 0.0, 0.0)
    for b in range(3):
        off = places.points[i, b] - length * t[b]
        seen = (seen[0] + off * R[b, 0], seen[1] + off * R[b, 1], seen[2] + off * R[b, 2])
    distance = math.sqrt(max(seen[0] ** 2 + seen[1] ** 2 + seen[2] ** 2, 1e-300))
    last = seen[0] / distance + places.reach
    for j in range(_first_from(places.directions, seen[0] / distance - places.reach), len(places.near)):
        if places.directions[j, 0] > last:
            break
        along = (
            seen[0] * places.directions[j, 0]
            + seen[1] * places.directions[j, 1]
            + seen[2] * places.directions[j, 2]
        )
        if along > places.near[j] * distance:
            return j if j != places.own[i] else -1
    return -1


@leaf
def _first_from(directions: FloatArray, x: float) -> int:
    """Return the first of the directions, in the order of x, that has at least this one."""
    low, high = 0, len(directions)
    while low < high:
        middle = (low + high) // 2
        if directions[middle, 0] < x:
            low = middle + 1
        else:
            high = middle
    return low
