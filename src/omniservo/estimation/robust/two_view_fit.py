"""From matched pixels to the best motion, and to the matches it rests on."""

from __future__ import annotations

import itertools
import math
from dataclasses import dataclass, replace

import numpy as np
from scipy.special import chdtrc, chdtri, fdtrc

from omniservo.estimation.matches import Matches
from omniservo.estimation.minimal_solvers.five_points import MOST_SOLUTIONS, five_point_essentials
from omniservo.estimation.refinement.epipolar_refinement import essential_matrix
from omniservo.estimation.refinement.motion_search import (
    EPIPOLAR_STEPS,
    FEW_POINTS,
    START_ANGLES,
    Minimum,
    eight_point_starts,
    refined_motion,
    search_motion,
)
from omniservo.estimation.robust.consensus import find_consensus, msac_score
from omniservo.estimation.robust.members import (
    GATE,
    MOTION_PARAMETERS,
    farthest_match,
    mark_members,
    members_of_consensus,
    sampling_threshold,
)
from omniservo.geometry.arrays import BoolArray, FloatArray

MANY_STARTS = 3
"""of many sampled matches; the others lead to the same minimum, or to one of many times the cost."""

LEAST_POINTS = 5
"""of the five-point algorithm; no fewer determine a motion."""

EIGHT_POINTS = 8
"""of the eight-point algorithm; fewer say nothing about their own noise."""

NEARLY_ALL = 0.9
"""Where so many matches agree with the motion of all, none need be sampled."""

NARROW = 2.0
"""Few matches are sampled within so many σ, where it is stated: the wider the gate, the more a motion gains
that bends to a wrong match and leaves all others half out."""

SHARPER = (1.0, 2.0)
"""times the pixels' own noise: gates in which the motion of a real camera's matches is looked for"""

SHARP_SHARE = 0.6
"""of the matches within wide gates must agree in narrow ones: fewer, and the camera's error is seen there"""

THING = 4
"""Matches that are wrong together: the corners of a tag"""

SIGNIFICANCE = 1e-3
"""Few matches are only rejected where chance explains the better fit with less than this probability."""

NEARLY_AS_GOOD = 100.0
"""Where leaving out one group or another has chances within this factor, few matches do not decide."""

UNSUSPICIOUS_NOISE_PX = 1.0
"""Few points can hide a wrong match in a bad motion; more noise than this makes them suspicious."""

SUSPICION = 0.05
"""Few matches with more noise than stated, by a chance below this, may hide a wrong one."""

SUSPICIOUS = 2.0
"""likewise of many matches, as a multiple of the noise that is stated"""


@dataclass(frozen=True, eq=False)
class TwoViewFit:
    """The minima of the pixel cost over the members."""

    members: BoolArray
    """(n,) matches in the cost"""
    minima: list[Minimum]
    """apart from each other, best first; empty where no start led to one"""
    instead: TwoViewFit | None = None
    """the fit to other members that explains all matches nearly as well"""

    @property
    def cost(self) -> float:
        """Σr² of the best minimum [px²]; infinite where there is none."""
        return self.minima[0].cost if self.minima else math.inf


def fit_two_views(matches: Matches, kind: int, robust: bool) -> TwoViewFit | None:
    """Return the fit to all matches, or to those that agree; None where fewer than five agree.

    Robust: matches are first fitted all together; only if they do not agree the members come from sampling.
    Not robust: many matches are only freed of those whose rays meet behind a camera; no point can be that.
    """
    everyone = np.ones(matches.size, dtype=np.bool_)
    if matches.size > FEW_POINTS:
        nearly = _nearly_all(matches, robust)
        if nearly is not None:
            members, start = nearly
            fit = fit_members(matches, members, kind, start)
            return _grown(matches, fit, kind) if robust and not members.all() else fit
        return _sampled(matches, kind, None)
    whole = fit_members(matches, everyone, kind, None)
    if not robust or matches.size < EIGHT_POINTS or _agree(whole, matches):
        return whole
    found = [_sampled(matches, kind, whole), _without_one_thing(matches, kind)]
    chances = [1.0 if fit is None else _chance(whole, fit, matches.noise_px) for fit in found]
    first = int(np.argmin(chances))
    chosen, other = found[first], found[1 - first]
    if chosen is None or chances[first] >= SIGNIFICANCE:
        return whole
    if other is not None and chances[1 - first] < NEARLY_AS_GOOD * chances[first]:
        return replace(chosen, instead=other)
    return chosen


def fit_members(
    matches: Matches, members: BoolArray, kind: int, prior: FloatArray | None, sampled: bool = False
) -> TwoViewFit:
    """Return the minima that ``prior`` and starts of the members' own lead to."""
    chosen = matches.where(members)
    starts = [] if prior is None else [prior[None]]
    if chosen.size < EIGHT_POINTS:
        starts.append(_five_point_starts(chosen))
    elif chosen.size <= FEW_POINTS:
        starts.append(eight_point_starts(chosen.bearings, START_ANGLES))
    elif sampled:
        starts.append(eight_point_starts(chosen.bearings, START_ANGLES[:MANY_STARTS]))
    return TwoViewFit(members, search_motion(chosen, kind, np.concatenate(starts)))


def sharper_fit(matches: Matches, wide: TwoViewFit, kind: int, own_px: float) -> tuple[Matches, TwoViewFit]:
    """Return the fit that does not bend to wrong matches, and the matches with the noise of its gates.

    Gates wide enough for a camera's model error, which motion and structure mostly absorb, have room for
    wrong matches. Of many beside one facade, a few of them turn the motion that the facade leaves half free.
    Where most matches agree to the pixels' own noise σ ``own_px``, and their motion puts members of the
    ``wide`` fit outside those gates, that one has bent to them.
    """
    for factor in SHARPER:
        narrow = matches.noisier(factor * own_px / matches.noise_px)
        sharp = fit_two_views(narrow, kind, True)
        if sharp is None or not sharp.minima or sharp.members.sum() < SHARP_SHARE * wide.members.sum():
            continue
        best, within = sharp.minima[0], sharp.members.copy()
        mark_members(matches, best.rotation, best.translation, GATE, within)
        return (narrow, sharp) if (wide.members & ~within).any() else (matches, wide)
    return matches, wide


def _five_point_starts(matches: Matches) -> FloatArray:
    """Return the essential matrices (s, 3, 3) of all samples of five, of few matches."""
    room, found = np.empty((MOST_SOLUTIONS, 3, 3)), []
    for sample in itertools.combinations(range(matches.size), LEAST_POINTS):
        count = five_point_essentials(matches.bearings, np.array(sample), room)
        found.append(room[:count].copy())
    return np.concatenate(found)


def _nearly_all(matches: Matches, robust: bool) -> tuple[BoolArray, FloatArray] | None:
    """Return the matches that agree with the motion of all, and its essential matrix; None: too few do."""
    rotation, translation, essential = np.empty((3, 3)), np.empty(3), np.empty((3, 3))
    start = eight_point_starts(matches.bearings, START_ANGLES[:1])[0]
    members = np.ones(matches.size, dtype=np.bool_)
    cost, _ = refined_motion(
        matches.bearings, matches.jacobians, start, EPIPOLAR_STEPS, rotation, translation
    )
    if math.isinf(cost):
        return None if robust else (members, start)
    essential_matrix(rotation, translation, essential)
    count, sigma = mark_members(matches, rotation, translation, GATE if robust else math.inf, members)
    if robust:
        least = NEARLY_ALL * matches.size
        if sigma > _largest_unsuspicious(matches.noise_px) or count < least:
            return None
        if count < matches.size and members_of_consensus(matches, essential, members) < least:
            return None
    return members, essential


def _sampled(matches: Matches, kind: int, whole: TwoViewFit | None) -> TwoViewFit | None:
    """Return the fit to the members that sampling finds, ``whole`` where it finds none; None: too few."""
    essential, members = np.empty((3, 3)), np.empty(matches.size, dtype=np.bool_)
    threshold = sampling_threshold(matches.noise_px)
    if whole is not None and matches.noise_px > 0.0:
        threshold = NARROW * matches.noise_px
    _, inliers = find_consensus(matches.bearings, matches.jacobians, threshold, 1, essential)
    least = min(matches.size, EIGHT_POINTS)
    if inliers < least or members_of_consensus(matches, essential, members) < least:
        return whole
    if members.all() and whole is not None:
        return whole
    fit = fit_members(matches, members, kind, essential, sampled=True)
    if len(fit.minima) > 1:
        fit = _of_all_matches(matches, fit, kind)
    return _grown(matches, fit, kind, sampled=True)


def _without_one_thing(matches: Matches, kind: int) -> TwoViewFit | None:
    """Return the best fit that one match and its nearest, the corners of a tag perhaps, are left out of.

    A motion that bends to all four of them does so in samples too: those are not free of them by chance.
    """
    best, tried = None, set()
    for pixels in matches.pixels[:, :2]:
        apart = np.square(matches.pixels[:, :2] - pixels).sum(axis=1)
        thing = np.argpartition(apart, THING - 1)[:THING]
        if matches.size - THING < EIGHT_POINTS or frozenset(thing.tolist()) in tried:
            continue
        tried.add(frozenset(thing.tolist()))
        members = np.ones(matches.size, dtype=np.bool_)
        members[thing] = False
        fit = fit_members(matches, members, kind, None)
        if best is None or fit.cost < best.cost:
            best = fit
    return best


def _of_all_matches(matches: Matches, fit: TwoViewFit, kind: int) -> TwoViewFit:
    """Return the fit to the members of the minimum that all matches, rejected ones too, agree with best.

    Members that a false minimum has chosen speak for it: their cost alone does not tell.
    """
    threshold, essential, members = sampling_threshold(matches.noise_px), np.empty((3, 3)), fit.members.copy()
    scores = []
    for minimum in fit.minima:
        essential_matrix(minimum.rotation, minimum.translation, essential)
        scores.append(msac_score(matches.bearings, matches.jacobians, essential, threshold, math.inf)[0])
    best = fit.minima[int(np.argmin(scores))]
    if best is fit.minima[0]:
        return fit
    essential_matrix(best.rotation, best.translation, essential)
    if members_of_consensus(matches, essential, members) < EIGHT_POINTS:
        return fit
    return fit_members(matches, members, kind, essential, sampled=True)


def _grown(matches: Matches, fit: TwoViewFit, kind: int, sampled: bool = False) -> TwoViewFit:
    """Return the fit after its own minimum, sharper than any sample's, has chosen the members once more."""
    if not fit.minima:
        return fit
    best, near, essential = fit.minima[0], fit.members.copy(), np.empty((3, 3))
    count, _ = mark_members(matches, best.rotation, best.translation, GATE, near)
    if count <= fit.members.sum():
        return fit
    essential_matrix(best.rotation, best.translation, essential)
    return fit_members(matches, near, kind, essential, sampled)


def _agree(fit: TwoViewFit, matches: Matches) -> bool:
    """Tell whether no match lies beyond the gate of all, and σ is that of pixels and not of blunders."""
    if not fit.minima:
        return False
    best = fit.minima[0]
    farthest, sigma = farthest_match(matches, best.rotation, best.translation)
    if farthest > GATE * sigma:
        return False
    freedom = max(matches.size - MOTION_PARAMETERS, 1)
    if matches.noise_px > 0.0:
        return bool(fit.cost <= chdtri(freedom, SUSPICION) * matches.noise_px**2)
    return max(sigma, math.sqrt(fit.cost / freedom)) <= UNSUSPICIOUS_NOISE_PX


def _largest_unsuspicious(stated: float) -> float:
    return SUSPICIOUS * stated if stated > 0.0 else UNSUSPICIOUS_NOISE_PX


def _chance(whole: TwoViewFit, chosen: TwoViewFit, stated: float) -> float:
    """Return by what chance leaving out any few brings so much: F, or χ² where σ is known."""
    kept = int(chosen.members.sum())
    dropped = len(chosen.members) - kept
    freedom = kept - MOTION_PARAMETERS
    if dropped == 0 or not chosen.minima:
        return 1.0
    if not whole.minima:
        return 0.0
    gain, variance = whole.cost - chosen.cost, chosen.cost / freedom
    if stated > 0.0:
        return float(chdtrc(dropped, max(gain, 0.0) / max(stated**2, variance)))
    return float(fdtrc(dropped, freedom, max(gain, 0.0) / (dropped * variance))) if variance > 0.0 else 0.0
