"""Four matches that are a square's corners: which squares agree with one motion.

Whatever its size and place, a square leaves five of its corners' twelve coordinates no choice: with corners
a, b, c, d in order round it, u = b − a, v = d − a and the side e,

    g = (a − b + c − d, (u·u − v·v)/2e, u·v/e)/e = 0.

Two different squares taken for one have corners that a motion may bend to, but their rays hardly meet in a
square as well. To first order in the noise the squares cost min dᵀC⁻¹d over displacements d of the corners
with g(h + d) = 0, C their joint covariance, the motion free to follow. That and the cost of the motion are
what all pixels say against all squares together. A square that is not what it is taken for is found by what
leaving it out brings: its 16 pixel coordinates have 7 parameters, so χ² with 9 degrees of freedom.

By chance a wrong one lies where some motion makes it a square again, mostly of another size. So where all
others are of one size, one that is not and that the motion rests on is left out, too.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np
from scipy.special import chdtrc, fdtrc

from omniservo.estimation.matches import Matches
from omniservo.estimation.refinement.motion_search import LEAST_NOISE_PX
from omniservo.estimation.robust.members import MOTION_PARAMETERS
from omniservo.estimation.robust.squared_corners import CONDITIONS, Squared, odd_size, squared
from omniservo.estimation.robust.two_view_fit import (
    EIGHT_POINTS,
    NEARLY_AS_GOOD,
    SIGNIFICANCE,
    SUSPICIOUS,
    TwoViewFit,
    fit_members,
    fit_two_views,
)
from omniservo.estimation.status.evidence import largest_noise, separation
from omniservo.estimation.uncertainty.first_order import determines_motion, linear_response
from omniservo.geometry.arrays import BoolArray, IntArray

FREEDOM = 9
"""of a square: 16 pixel coordinates less 3 of its place, 3 of its orientation and its side"""

USUAL = 0.5
"""Squares that leave less than that are not checked one by one."""

DOUBT = 0.05
"""Leaving out one of the squares is named where chance explains what it brings with less than this."""

LEAST_ALIKE = 3
"""So many squares of one size make another one of another size doubtful."""

DECISIVE = 2.0
"""A square of another size is left out where it makes the motion's variance so many times smaller: where it
says more than all others."""


@dataclass(frozen=True, eq=False)
class _Explained:
    """The fit to some matches, and what it leaves of them and of their squares."""

    fit: TwoViewFit
    """its minima by what they leave of squares, too; without those that the squares speak against"""
    cost: float
    """of the motion and of the squares [px²]"""
    freedom: int
    corners: Squared | None
    """of the squares, in the best minimum"""

    def variance(self, stated: float) -> float:
        """Return σ² [px²]: what is stated, or what is left, if that is more."""
        return max(self.cost / max(self.freedom, 1), stated**2, LEAST_NOISE_PX**2)

    def margin(self, stated: float) -> float:
        """Return how much more [px²] is nearly as good."""
        return 2.0 * math.log(NEARLY_AS_GOOD) * self.variance(stated)


def fit_squares(matches: Matches, squares: IntArray, kind: int) -> tuple[TwoViewFit | None, str]:
    """Return the fit as `fit_two_views` has it, free of squares that are not what they are taken for.

    Squares are left out one after the other, each time the one without which least is left, while chance
    explains what that brings with less than `SIGNIFICANCE`. Where leaving out another one would do nearly as
    well, or leaving out one more brings what chance explains with less than `DOUBT`, that fit is the answer's
    ``instead``, the one farthest from it of several. A sentence comes with it where the squares left agree
    with no motion.

    Args:
        matches: all.
        squares: (m, 4) matches, the corners in order round each.
        kind: s_R of the joint refinement.
    """
    kept, left, stated = np.ones(matches.size, dtype=np.bool_), list(range(len(squares))), matches.noise_px
    rivals: list[TwoViewFit] = []
    while True:
        whole = _explained(matches, kept, squares[left], kind)
        if stated > 0.0 and chdtrc(whole.freedom, whole.cost / stated**2) >= USUAL:
            break
        tried = _without_each(matches, kept, squares, left, kind)
        if not tried:
            break
        chances = [_chance(whole, other, stated) for _, other in tried]
        worst, best = tried[0]
        if chances[0] * len(left) >= SIGNIFICANCE:
            rivals += [other.fit for (_, other), chance in zip(tried, chances, strict=True) if chance < DOUBT]
            break
        rivals = [other.fit for _, other in tried[1:] if other.cost < best.cost + best.margin(stated)]
        left.remove(worst)
        kept[squares[worst]] = False
    whole = _without_odd(matches, kept, squares, left, kind, whole)
    if whole.fit.minima and 4 * len(left) == kept.sum():
        return _beside(whole.fit, rivals), _disagreement(whole, len(left), stated)
    fit = fit_two_views(matches.where(kept), kind, robust=True)
    if fit is None:
        return None, ""
    members = np.zeros(matches.size, dtype=np.bool_)
    members[kept] = fit.members
    return _beside(replace(fit, members=members), rivals), ""


def _without_odd(
    matches: Matches, kept: BoolArray, squares: IntArray, left: list[int], kind: int, whole: _Explained
) -> _Explained:
    """Return what is explained without the square of another size than all others, where it is decisive.

    It is then no longer ``kept`` and ``left``.
    """
    if whole.corners is None or len(left) <= LEAST_ALIKE:
        return whole
    odd = odd_size(whole.corners, whole.variance(matches.noise_px))
    if odd is None:
        return whole
    others, rest = kept.copy(), [k for k in left if k != left[odd]]
    others[squares[left[odd]]] = False
    without = _explained(matches, others, squares[rest], kind)
    if _spread(matches, without) <= DECISIVE * _spread(matches, whole):
        return whole
    kept[:], left[:] = others, rest
    return without


def _spread(matches: Matches, explained: _Explained) -> float:
    """Return the largest variance of the motion [rad²/px²]; infinite where it is free."""
    fit = explained.fit
    if not fit.minima:
        return math.inf
    members, best = matches.where(fit.members), fit.minima[0]
    arrays = (members.parameters, members.pixels, members.weights)
    solution = (best.rotation, best.translation, best.points)
    if not determines_motion(*arrays, *solution):
        return math.inf
    noise = np.tile(np.eye(2).ravel(), (members.size, 2))
    return float(np.linalg.eigvalsh(linear_response(*arrays, noise, *solution, None).unscaled)[-1])


def _beside(fit: TwoViewFit, rivals: list[TwoViewFit]) -> TwoViewFit:
    """Return the fit with the rival whose motion is the farthest from its own."""
    if not fit.minima:
        return fit
    apart = [max(separation(fit.minima[0], rival.minima[0])) if rival.minima else 0.0 for rival in rivals]
    return replace(fit, instead=rivals[int(np.argmax(apart))] if rivals else None)


def _without_each(
    matches: Matches, kept: BoolArray, squares: IntArray, left: list[int], kind: int
) -> list[tuple[int, _Explained]]:
    """Return each square with what is left without it, least first; none where too few matches are left."""
    tried = []
    for k in left:
        others = kept.copy()
        others[squares[k]] = False
        if others.sum() >= EIGHT_POINTS:
            tried.append((k, _explained(matches, others, squares[[i for i in left if i != k]], kind)))
    return sorted(tried, key=lambda case: case[1].cost)


def _explained(matches: Matches, kept: BoolArray, squares: IntArray, kind: int) -> _Explained:
    """Fit the kept matches; ``squares`` are those of them that are squares."""
    fit, members = fit_members(matches, kept.copy(), kind, None, sampled=True), matches.where(kept)
    freedom = members.size - MOTION_PARAMETERS + CONDITIONS * len(squares)
    places = (np.cumsum(kept) - 1)[squares]
    corners = [squared(members, m, places) for m in fit.minima]
    costs = [m.cost + (c.cost if c else 0.0) for m, c in zip(fit.minima, corners, strict=True)]
    best = int(np.argmin(costs)) if costs else 0
    least = _Explained(fit, costs[best] if costs else math.inf, freedom, corners[best] if costs else None)
    most = least.cost + least.margin(matches.noise_px)
    near = [fit.minima[i] for i in np.argsort(costs) if costs[i] <= most]
    return replace(least, fit=replace(fit, minima=near))


def _chance(whole: _Explained, other: _Explained, stated: float) -> float:
    """Return by what chance leaving out any square brings so much."""
    if math.isinf(other.cost):
        return 1.0
    gain = max(whole.cost - other.cost, 0.0) / other.variance(stated)
    if stated > 0.0:
        return float(chdtrc(FREEDOM, gain))
    return float(fdtrc(FREEDOM, other.freedom, gain / FREEDOM))


def _disagreement(whole: _Explained, count: int, stated: float) -> str:
    """Return the evidence that the squares are none: more noise than their pixels can have, or F."""
    freedom, more = max(whole.freedom - CONDITIONS * count, 1), max(CONDITIONS * count, 1)
    variance = max(whole.fit.cost / freedom, stated**2, LEAST_NOISE_PX**2)
    chance = float(fdtrc(more, freedom, (whole.cost - whole.fit.cost) / (more * variance)))
    noise = math.sqrt(whole.cost / max(whole.freedom, 1))
    most = SUSPICIOUS * stated if stated > 0.0 and 4 * (count - 1) < EIGHT_POINTS else largest_noise(stated)
    if chance >= SIGNIFICANCE and noise <= most:
        return ""
    words = f" where {stated:.2g} px is stated" if stated > 0.0 else ""
    return (
        f"the {count} tags are no squares under the best motion, which leaves {noise:.2g} px of noise{words}:"
        " one is taken for another, or the camera is another one"
    )
