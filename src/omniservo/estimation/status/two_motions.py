"""Whether two motions explain the matches better than one.

A group of points that moves by itself, a pattern that is matched one period off and a symmetric body that is
matched to its turned self have a motion of their own. Where the one motion of an estimate leaves them out,
they agree with each other; where it bends to them, it leaves more noise than each of two motions does. Per
match, with the density of its epipolar distance d,

    ln L = Σ over the motions of kᵢ (ln(kᵢ/n) − ln σᵢ) − (n − Σ kᵢ) ln w − (5/2) ln n for each motion

w [px] over which the distance of a wrong match is spread evenly. Two motions are accepted where that is
larger by `DECISIVE`, and where chance does not gather the second one's members: of r matches left out, the
expected number of groups of k that agree with one motion to g σ is C(r, k) C(k, 5) s (2gσ/w)ᵏ⁻⁵, s solutions
of five points (a-contrario test; Moisan and Stival, IJCV 2004).
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import NamedTuple

import numpy as np

from omniservo.estimation.matches import Matches
from omniservo.estimation.refinement.epipolar_refinement import essential_matrix, sampson_distances
from omniservo.estimation.refinement.motion_search import LEAST_NOISE_PX, Minimum
from omniservo.estimation.robust.consensus import find_consensus
from omniservo.estimation.robust.members import GATE, MOTION_PARAMETERS, mark_members
from omniservo.estimation.robust.two_view_fit import (
    EIGHT_POINTS,
    SIGNIFICANCE,
    TwoViewFit,
    fit_members,
    fit_two_views,
)
from omniservo.estimation.status.duplicate_structure import duplicate_structure
from omniservo.estimation.status.evidence import two_motions_apart
from omniservo.estimation.status.moving_planes import bent_to_plane
from omniservo.estimation.two_view_estimate import Status
from omniservo.geometry.arrays import FloatArray
from omniservo.geometry.false_alarms import false_alarms

DECISIVE = math.log(1e3)
SOLUTIONS = 4
"""that five points usually leave"""
LEAST_SIGMA_PX = 0.1
"""Where nothing is stated no motion is taken to leave less noise than this: few matches can, by chance."""
COHERENT = 0.7
"""Share of the goal pixels' variance that an affine map of the initial ones explains, of matches that may
have a motion of their own; of wrong ones it explains hardly any, and searching these takes long"""
LEAST_SHARE = 0.15
"""of the first motion's matches: among hundreds of real ones, fewer agree on what the camera did not do"""
TAIL, BLUNT_TAIL, BLUNT = 5.0, 15.0, 1.5
"""σ from the first motion: matches nearer than that are its own, badly found; the second number where what
they themselves leave is more than ``BLUNT`` times the first motion's σ"""
SUSPICIOUS = 1.25
"""σ over what is stated, or over `UNSTATED_PX`, from which a motion may be one that bends to two"""
UNSTATED_PX = 0.45
TIGHTER = (1.0, 0.5)
"""of the σ that the one motion leaves: gates of two σ in which a motion is looked for that does not bend"""


def second_motion(
    matches: Matches, fit: TwoViewFit, kind: int, error_px: float
) -> tuple[TwoViewFit, TwoViewFit] | None:
    """Return two fits, each to matches of its own, that explain all better than ``fit``; None: it is best.

    ``error_px`` is the standard deviation of the camera's model error.
    """
    n, alone = matches.size, _sigma(matches, fit)
    if n < 2 * EIGHT_POINTS:
        return None
    one = _likelihood(matches, [(int(fit.members.sum()), alone)])
    for first in _firsts(matches, fit, kind, alone):
        left = ~first.members
        if not first.minima or left.sum() < EIGHT_POINTS or not _is_coherent(matches.pixels[left]):
            continue
        inside = fit_two_views(matches.where(left), kind, True)
        if inside is None or not inside.minima:
            continue
        members = np.zeros(n, dtype=np.bool_)
        members[np.flatnonzero(left)[inside.members]] = True
        second = TwoViewFit(members, inside.minima)
        groups = [(int(f.members.sum()), _sigma(matches, f)) for f in (first, second)]
        if groups[1][0] < LEAST_SHARE * groups[0][0]:
            continue
        by_chance = _by_chance(matches, int(left.sum()), *groups[1]) > SIGNIFICANCE
        tail = BLUNT_TAIL if groups[1][1] > BLUNT * groups[0][1] else TAIL
        if by_chance or _is_near(matches, first, second, tail * math.hypot(groups[0][1], error_px)):
            continue
        if _likelihood(matches, groups) > one + DECISIVE:
            return first, second
    return None


class Judged(NamedTuple):
    """What other motions leave of a pose."""

    status: Status = "ok"
    words: str = ""
    """one sentence with the evidence"""
    motions: tuple[Minimum, ...] = ()
    """both, where there are two"""
    doubts: tuple[TwoViewFit, ...] = ()
    """what parts of the matches say alone, where one motion stands but may have bent"""


def judge_others(matches: Matches, fit: TwoViewFit, kind: int, error_px: float) -> Judged:
    """Return whether one motion stands beside others.

    Args:
        matches: all of them.
        fit: a pose, as far as its members tell.
        kind: of the rotation's parameters.
        error_px: standard deviation of the camera's model error [px].
    """
    pair, count = second_motion(matches, fit, kind, error_px), int(fit.members.sum())
    if pair is not None:
        one, other = pair
        return Judged(
            "ambiguous",
            f"{two_motions_apart(one.minima[0], other.minima[0])}"
            f" explain {one.members.sum()} and {other.members.sum()} of {matches.size} matches:"
            " something moves by itself, or is matched to what only looks like it",
            (one.minima[0], other.minima[0]),
        )
    bent = bent_to_plane(matches, fit, kind, error_px)
    if bent.instead is not None:
        rest, plane = bent.instead
        return Judged(
            "ambiguous",
            f"{two_motions_apart(fit.minima[0], rest.minima[0])}: one bends to {count} of {matches.size}"
            f" matches, the other leaves less of {rest.members.sum()}, and {plane.sum()} beside them,"
            " nearly a plane, move by themselves",
            (rest.minima[0], fit.minima[0]),
        )
    for first in _firsts(matches, fit, kind, _sigma(matches, fit)):
        duplicate = duplicate_structure(matches, first)
        if duplicate is not None:
            return Judged(
                "ambiguous",
                f"{two_motions_apart(first.minima[0], duplicate.motion)}: under the second, with which five"
                f" of {matches.size - first.members.sum()} outliers agree, {duplicate.doubles} of"
                f" {duplicate.checked} inliers are seen where others are: a structure"
                " that repeats, matched to what only looks like it",
                (first.minima[0], duplicate.motion),
            )
    chance = _by_chance(matches, matches.size, count, _sigma(matches, fit))
    if 2 * count < matches.size and chance > SIGNIFICANCE:  # where most agree, most matches are right
        words = f"{count} of {matches.size} matches agree with a motion: chance gathers as many"
        return Judged("too_few_points", words)
    return Judged(doubts=tuple(bent.doubts))


def two_of(fit: TwoViewFit, status: Status) -> tuple[Minimum, ...]:
    """Return the two motions of a fit that is ambiguous, the likelier first; none of any other."""
    if status != "ambiguous":
        return ()
    instead = [] if fit.instead is None else fit.instead.minima
    return fit.minima[0], (fit.minima[1:] + instead)[0]


def _firsts(matches: Matches, fit: TwoViewFit, kind: int, sigma: float) -> Iterator[TwoViewFit]:
    """Yield the fit itself, and fits to what agrees more closely with a motion than all its members do."""
    yield fit
    if sigma < SUSPICIOUS * (matches.noise_px or UNSTATED_PX):
        return
    essential, distances = np.empty((3, 3)), np.empty(matches.size)
    for part in TIGHTER:
        threshold = 2.0 * max(part * sigma, LEAST_SIGMA_PX)
        find_consensus(matches.bearings, matches.jacobians, threshold, 1, essential)
        sampson_distances(matches.bearings, matches.jacobians, essential, distances)
        members = np.abs(distances) < threshold
        if members.sum() < EIGHT_POINTS:
            continue
        first = fit_members(matches, members, kind, essential, sampled=True)
        if first.minima:
            best = first.minima[0]
            mark_members(matches, best.rotation, best.translation, GATE, members)
            if members.sum() >= EIGHT_POINTS:
                essential_matrix(best.rotation, best.translation, essential)
                yield fit_members(matches, members, kind, essential, sampled=True)


def _is_near(matches: Matches, first: TwoViewFit, second: TwoViewFit, near: float) -> bool:
    """Tell whether most of the second's matches are within ``near`` px of the first motion."""
    best, essential, distances = first.minima[0], np.empty((3, 3)), np.empty(matches.size)
    essential_matrix(best.rotation, best.translation, essential)
    sampson_distances(matches.bearings, matches.jacobians, essential, distances)
    return bool(np.median(np.abs(distances[second.members])) < near)


def _is_coherent(pixels: FloatArray) -> bool:
    """Tell whether an affine map explains most matches (n, 4), the worst quarter aside."""
    for _ in range(2):
        about = pixels - pixels.mean(axis=0)
        initial, goal = about[:, :2], about[:, 2:]
        spread = initial.T @ initial + 1e-9 * np.eye(2)
        off = np.square(goal - initial @ np.linalg.solve(spread, initial.T @ goal)).sum(axis=1)
        share = 1.0 - off.sum() / max(float(np.square(goal).sum()), 1e-9)
        pixels = pixels[off <= np.partition(off, 3 * len(off) // 4)[3 * len(off) // 4]]
    return bool(share > COHERENT)


def _sigma(matches: Matches, fit: TwoViewFit) -> float:
    freedom = max(int(fit.members.sum()) - MOTION_PARAMETERS, 1)
    left = math.sqrt(fit.minima[0].cost / freedom) if fit.minima else math.inf
    return max(left, matches.noise_px, LEAST_NOISE_PX if matches.noise_px > 0.0 else LEAST_SIGMA_PX)


def _width(matches: Matches) -> float:
    """Return over how many pixels the epipolar distances of wrong matches are spread."""
    return max(0.5 * math.hypot(*np.ptp(matches.pixels[:, 2:], axis=0)), 1.0)


def _likelihood(matches: Matches, groups: list[tuple[int, float]]) -> float:
    n, left = matches.size, matches.size - sum(k for k, _ in groups)
    wrong = left * (math.log(max(left, 1) / n) - math.log(_width(matches)))
    right = sum(k * (math.log(k / n) - math.log(sigma)) for k, sigma in groups)
    return right + wrong - 0.5 * MOTION_PARAMETERS * len(groups) * math.log(n)


def _by_chance(matches: Matches, left: int, k: int, sigma: float) -> float:
    return false_alarms(left, k, MOTION_PARAMETERS, 2.0 * GATE * sigma / _width(matches), SOLUTIONS)
