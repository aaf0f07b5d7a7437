"""From matched pixels to the best motion, and to the matches it rests on."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from scipy.special import chdtri, fdtri

from omniservo.estimation.consensus import find_consensus
from omniservo.estimation.epipolar_refinement import (
    essential_matrix,
    refine_epipolar,
    sampson_distances,
)
from omniservo.estimation.essential_matrix import mark_in_front, motion_in_front
from omniservo.estimation.joint_refinement import FARTHEST, write_residuals
from omniservo.estimation.matches import Matches
from omniservo.estimation.motion_search import (
    START_ANGLES,
    Minimum,
    eight_point_starts,
    refined_motion,
    search_motion,
)
from omniservo.geometry.arrays import BoolArray, FloatArray

LEAST_POINTS = 8
"""of the eight-point algorithm."""

MOTION_PARAMETERS = 5
"""Rotation and direction; every match leaves one equation after its point is eliminated."""

FEW_POINTS = 40
"""Up to here five starts are worth their time; beyond, one finds the minimum."""

SAMPLE_THRESHOLD_PX = 2.0
"""Sampson distance at which a match stops to count while sampling, where no noise is stated."""

GATE = 3.5
"""A match farther than this many σ from the epipolar geometry of the others is rejected."""

PRIOR_NOISE_PX = 0.5
PRIOR_WEIGHT = 4.0
"""While matches are chosen, σ is blended with this prior, worth so many matches: a handful of residuals
that happen to be small must not reject the rest."""

SIGNIFICANCE = 1e-3
"""Few matches are only rejected where chance explains the better fit with less than this probability."""

UNSUSPICIOUS_NOISE_PX = 1.0
"""Few points can hide a wrong match in a bad motion; more noise than this makes them suspicious."""

SUSPICIOUS = 2.0
"""likewise, as a multiple of the noise that is stated"""


@dataclass(frozen=True, eq=False)
class TwoViewFit:
    """The minima of the pixel cost over the members."""

    members: BoolArray
    """(n,) matches in the cost"""
    minima: list[Minimum]
    """apart from each other, best first; empty where no start led to one"""

    @property
    def cost(self) -> float:
        """Σr² of the best minimum [px²]; infinite where there is none."""
        return self.minima[0].cost if self.minima else math.inf


def fit_two_views(matches: Matches, kind: int, robust: bool) -> TwoViewFit | None:
    """Return the fit to all matches, or to those that agree; None where fewer than eight agree.

    Robust: few matches are first fitted all together; only if they do not agree, and always where they are
    many, the members come from sampling. Not robust: many matches are only freed of those whose rays meet
    behind a camera; no point can be that.
    """
    n = len(matches.pixels)
    everyone = np.ones(n, dtype=np.bool_)
    if not robust:
        return _fit(matches, everyone if n <= FEW_POINTS else _possible(matches), kind, None)
    whole = None
    if n <= FEW_POINTS:
        whole = _fit(matches, everyone, kind, None)
        if _agree(whole, matches):
            return whole
    essential = np.empty((3, 3))
    _, inliers = find_consensus(matches.bearings, matches.jacobians, _threshold(matches), 1, essential)
    if inliers < LEAST_POINTS:  # every sample is degenerate: so are all matches together, and judged as that
        return whole or _fit(matches, everyone, kind, None)
    members = _members(matches, essential)
    if members.sum() < LEAST_POINTS:
        return whole
    if members.all() and whole is not None:
        return whole
    chosen = _grown(matches, _fit(matches, members, kind, essential), kind)
    if whole is not None and not _significant(whole, chosen, matches.noise_px):
        return whole
    return chosen


def _fit(matches: Matches, members: BoolArray, kind: int, prior: FloatArray | None) -> TwoViewFit:
    chosen = matches.where(members)
    starts = [] if prior is None else [prior]
    if len(chosen.pixels) <= FEW_POINTS:
        starts += eight_point_starts(chosen, START_ANGLES)
    elif prior is None:
        starts += eight_point_starts(chosen, START_ANGLES[:1])
    return TwoViewFit(members, search_motion(chosen, kind, starts))


def _grown(matches: Matches, fit: TwoViewFit, kind: int) -> TwoViewFit:
    """Return the fit after its own minimum, sharper than any sample's, has chosen the members once more."""
    if not fit.minima:
        return fit
    best = fit.minima[0]
    distances, essential = _distances(matches, best.rotation, best.translation)
    near = np.abs(distances) <= GATE * _blended_noise(distances[fit.members], matches.noise_px)
    near &= ~_behind(matches, best.rotation, best.translation)
    if near.sum() <= fit.members.sum():
        return fit
    return _fit(matches, near, kind, essential)


def _agree(fit: TwoViewFit, matches: Matches) -> bool:
    """Tell whether no match lies beyond the gate of all, and σ is that of pixels and not of blunders."""
    if not fit.minima:
        return False
    distances, _ = _distances(matches, fit.minima[0].rotation, fit.minima[0].translation)
    sigma = _blended_noise(distances, matches.noise_px)
    noise = math.sqrt(fit.cost / max(len(distances) - MOTION_PARAMETERS, 1))
    most = UNSUSPICIOUS_NOISE_PX if matches.noise_px is None else SUSPICIOUS * matches.noise_px
    return bool(np.abs(distances).max() <= GATE * sigma) and max(sigma, noise) <= most


def _members(matches: Matches, essential: FloatArray) -> BoolArray:
    """Return the matches near the epipolar geometry that a robust refinement makes of ``essential``."""
    rotation, translation = np.empty((3, 3)), np.empty(3)
    distances, weights = np.empty(len(matches.pixels)), np.empty(len(matches.pixels))
    sampson_distances(matches.bearings, matches.jacobians, essential, distances, weights)
    members = np.abs(distances) < _threshold(matches)
    for _ in range(3):
        if members.sum() < LEAST_POINTS:
            break
        chosen = matches.where(members)
        sigma = _blended_noise(distances[members], matches.noise_px)
        if motion_in_front(chosen.bearings, essential, rotation, translation) < 0:
            break
        refine_epipolar(chosen.bearings, chosen.jacobians, 2.0 * sigma, rotation, translation, 20)
        distances, essential = _distances(matches, rotation, translation)
        sigma = _blended_noise(distances[members], matches.noise_px)
        near = np.abs(distances) <= GATE * sigma
        if (near == members).all():
            break
        members = near
    if motion_in_front(matches.bearings[members], essential, rotation, translation) >= 0:
        members &= ~_behind(matches, rotation, translation)
    return members


def _possible(matches: Matches) -> BoolArray:
    """Return the matches that can be points at all: those of which the rays do not meet behind a camera."""
    motion = refined_motion(matches, eight_point_starts(matches, START_ANGLES[:1])[0])
    if motion is None:
        return np.ones(len(matches.pixels), dtype=np.bool_)
    return ~_behind(matches, motion[1], motion[2])


def _behind(matches: Matches, rotation: FloatArray, translation: FloatArray) -> BoolArray:
    """Return which rays meet behind a camera, by more than a point at infinity seen with noise could."""
    n = len(matches.pixels)
    in_front = np.empty(n, dtype=np.bool_)
    mark_in_front(matches.bearings, rotation, translation, in_front)
    behind = ~in_front
    if behind.any():
        far, residuals = matches.bearings[:, :3] * FARTHEST, np.empty((n, 4))
        write_residuals(matches.parameters, matches.pixels, rotation, translation, far, residuals)
        behind &= ~(np.hypot(residuals[:, 2], residuals[:, 3]) < SAMPLE_THRESHOLD_PX)
    return behind


def _distances(
    matches: Matches, rotation: FloatArray, translation: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Return the Sampson distances (n,) [px] under a motion, and its essential matrix."""
    n = len(matches.pixels)
    essential, distances, weights = np.empty((3, 3)), np.empty(n), np.empty(n)
    essential_matrix(rotation, translation, essential)
    sampson_distances(matches.bearings, matches.jacobians, essential, distances, weights)
    return distances, essential


def _threshold(matches: Matches) -> float:
    """Return the Sampson distance [px] at which a match stops to count while sampling."""
    return SAMPLE_THRESHOLD_PX if matches.noise_px is None else GATE * matches.noise_px


def _blended_noise(distances: FloatArray, stated: float | None) -> float:
    """Return σ [px]: what is stated, or from the median distance (so outliers do not enter) and the prior."""
    if stated is not None:
        return stated
    n = len(distances)
    robust = 1.4826 * float(np.median(np.abs(distances)))
    freedom = max(n - MOTION_PARAMETERS, 1)
    square = robust * robust * n
    return math.sqrt((PRIOR_WEIGHT * PRIOR_NOISE_PX**2 + square) / (PRIOR_WEIGHT + freedom))


def _significant(whole: TwoViewFit, chosen: TwoViewFit, stated: float | None) -> bool:
    """F test (χ² where σ is known): do members fit better, beyond what leaving out any few would bring?"""
    kept = int(chosen.members.sum())
    dropped = len(chosen.members) - kept
    freedom = kept - MOTION_PARAMETERS
    if dropped == 0 or not chosen.minima:
        return False
    if not whole.minima:
        return True
    gain = whole.cost - chosen.cost
    if stated is not None:
        return bool(gain > chdtri(dropped, SIGNIFICANCE) * stated**2)
    return bool(gain > dropped * fdtri(dropped, freedom, 1.0 - SIGNIFICANCE) * chosen.cost / freedom)
