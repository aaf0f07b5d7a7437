"""Four matches that are a square's corners: which squares agree with one motion.

Whatever its size and place, a square leaves five of its corners' twelve coordinates no choice: with corners
a, b, c, d in order round it, u = b − a, v = d − a and the side e,

    g = (a − b + c − d, (u·u − v·v)/2e, u·v/e)/e = 0.

Two different squares taken for one have corners that a motion may bend to, but their rays hardly meet in a
square as well. To first order in the noise the squares cost min dᵀC⁻¹d over displacements d of the corners
with g(h + d) = 0, C their joint covariance, the motion free to follow. That and the cost of the motion are
what all pixels say against all squares together. A square that is not what it is taken for is found by what
leaving it out brings: its 16 pixel coordinates have 7 parameters, so χ² with 9 degrees of freedom.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np
from scipy.special import chdtrc, fdtrc

from omniservo.estimation.evidence import largest_noise, separation
from omniservo.estimation.matches import Matches
from omniservo.estimation.members import MOTION_PARAMETERS
from omniservo.estimation.motion_search import LEAST_NOISE_PX, Minimum
from omniservo.estimation.two_view_fit import (
    EIGHT_POINTS,
    NEARLY_AS_GOOD,
    SIGNIFICANCE,
    SUSPICIOUS,
    TwoViewFit,
    fit_members,
    fit_two_views,
)
from omniservo.estimation.uncertainty import determines_motion, linear_response
from omniservo.geometry.arrays import BoolArray, FloatArray, IntArray

CONDITIONS = 5
"""of a square, see g above"""
FREEDOM = 9
"""of a square: 16 pixel coordinates less 3 of its place, 3 of its orientation and its side"""

PRINTED = 0.005
"""A print is a square but for so much of its side, and so is what a calibration makes of it."""

STEPS = 4
"""of Gauss-Newton on g"""

USUAL = 0.5
"""Squares that leave less than that are not looked at one by one."""

DOUBT = 0.05
"""Leaving out one of the squares is named where chance explains what it brings with less than this."""


@dataclass(frozen=True, eq=False)
class _Explained:
    """The fit to some matches, and what it leaves of them and of their squares."""

    fit: TwoViewFit
    """its minima by what they leave of squares, too; without those that the squares speak against"""
    cost: float
    """of the motion and of the squares [px²]"""
    freedom: int

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
        chances = [_chance(whole, other, stated) * len(left) for _, other in tried]
        worst, best = tried[0]
        if chances[0] >= SIGNIFICANCE:
            rivals += [other.fit for (_, other), chance in zip(tried, chances, strict=True) if chance < DOUBT]
            break
        rivals = [other.fit for _, other in tried[1:] if other.cost < best.cost + best.margin(stated)]
        left.remove(worst)
        kept[squares[worst]] = False
    if whole.fit.minima and 4 * len(left) == kept.sum():
        return _beside(whole.fit, rivals), _disagreement(whole, len(left), stated)
    fit = fit_two_views(matches.where(kept), kind, robust=True)
    if fit is None:
        return None, ""
    members = np.zeros(matches.size, dtype=np.bool_)
    members[kept] = fit.members
    return _beside(replace(fit, members=members), rivals), ""


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
    costs = [m.cost + cost_of_squares(members, m, places) for m in fit.minima]
    least = _Explained(fit, min(costs, default=math.inf), freedom)
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


def cost_of_squares(members: Matches, minimum: Minimum, squares: IntArray) -> float:
    """Return by how much [px²] the cost of a minimum grows if the squares (m, 4) are squares."""
    n = members.size
    arrays = (members.parameters, members.pixels, members.weights)
    solution = (minimum.rotation, minimum.translation, minimum.points)
    if len(squares) == 0 or not determines_motion(*arrays, *solution):
        return 0.0
    rows, own = linear_response(*arrays, np.tile(np.eye(2).ravel(), (n, 2)), *solution, None).law()
    corners = squares.ravel()
    shared = rows[:, 6:].reshape(len(rows), n, 3)[:, corners].reshape(len(rows), -1)
    spread = shared.T @ shared
    for i, corner in enumerate(corners):
        spread[3 * i : 3 * i + 3, 3 * i : 3 * i + 3] += own[corner]
    variance = max(minimum.cost / max(n - MOTION_PARAMETERS, 1), members.noise_px**2, LEAST_NOISE_PX**2)
    slack = PRINTED**2 / variance * np.eye(CONDITIONS * len(squares))
    moved, cost = np.zeros(len(spread)), 0.0
    for _ in range(STEPS):
        gaps, slopes = square_gaps(minimum.points[squares] + moved.reshape(-1, 4, 3))
        missing = gaps - slopes @ moved
        back = np.linalg.solve(slopes @ spread @ slopes.T + slack, missing)
        moved, cost = -spread @ (slopes.T @ back), float(missing @ back)
    return max(cost, 0.0) if math.isfinite(cost) else 0.0


def square_gaps(corners: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return g (5m,) of four corners each (m, 4, 3) and its derivative (5m, 12m), the sides e held."""
    m = len(corners)
    a, b, c, d = np.swapaxes(corners, 0, 1)
    u, v, gap = b - a, d - a, a - b + c - d
    square = 0.5 * (np.sum(u * u, axis=1) + np.sum(v * v, axis=1))
    side = np.sqrt(square)[:, None]
    sides, angle = 0.5 * np.sum(u * u - v * v, axis=1) / square, np.sum(u * v, axis=1) / square
    gaps = np.column_stack((gap / side, sides, angle))
    slopes = np.zeros((m, CONDITIONS, m, 4, 3))
    signs = np.array([1.0, -1.0, 1.0, -1.0])
    for i in range(m):
        for k in range(3):
            slopes[i, k, i, :, k] = signs / side[i]
        slopes[i, 3, i, 1], slopes[i, 3, i, 3] = u[i] / square[i], -v[i] / square[i]
        slopes[i, 4, i, 1], slopes[i, 4, i, 3] = v[i] / square[i], u[i] / square[i]
        slopes[i, 3:, i, 0] = -slopes[i, 3:, i, 1] - slopes[i, 3:, i, 3]
    return gaps.ravel(), slopes.reshape(CONDITIONS * m, 12 * m)
