"""From matched pixels to the best motion, and to the matches it rests on."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from scipy.special import fdtri

from omniservo.cameras import UnifiedCamera
from omniservo.errors import InputError
from omniservo.estimation.consensus import find_consensus
from omniservo.estimation.epipolar_refinement import (
    essential_matrix,
    refine_epipolar,
    sampson_distances,
)
from omniservo.estimation.essential_matrix import bearings_of_pixels, motion_in_front, ray_distances
from omniservo.estimation.motion_search import START_ANGLES, motion_and_structure
from omniservo.geometry.arrays import BoolArray, FloatArray

LEAST_POINTS = 8
"""of the eight-point algorithm."""

MOTION_PARAMETERS = 5
"""Rotation and direction; every match leaves one equation after its point is eliminated."""

FEW_POINTS = 40
"""Up to here five starts are worth their time; beyond, one finds the minimum."""

SAMPLE_THRESHOLD_PX = 2.0
"""Sampson distance at which a match stops to count while sampling."""

GATE = 3.5
"""A match farther than this many σ from the epipolar geometry of the others is rejected."""

PRIOR_NOISE_PX = 0.5
PRIOR_WEIGHT = 4.0
"""While matches are chosen, σ is blended with this prior, worth so many matches: a handful of residuals
that happen to be small must not reject the rest."""

SIGNIFICANCE = 1e-3
"""Few matches are only rejected where chance explains the better fit with less than this probability."""

LARGEST_NOISE_PX = 5.0
"""Pixels that leave a larger σ do not belong to one rigid scene seen by this camera."""


@dataclass(frozen=True, eq=False)
class Matches:
    """Pixels with their bearings: rows of the kernels' arrays."""

    parameters: FloatArray
    """of the camera"""
    pixels: FloatArray
    """(n, 4) initial and goal [px]"""
    bearings: FloatArray
    """(n, 6)"""
    jacobians: FloatArray
    """(n, 12) bearings by pixels"""

    @classmethod
    def of_pixels(cls, camera: UnifiedCamera, pixels: FloatArray) -> Matches:
        """Unproject ``pixels`` (n, 4).

        Raises:
            InputError: a pixel lies outside the domain in which the camera can be unprojected.
        """
        n = len(pixels)
        bearings, jacobians = np.empty((n, 6)), np.empty((n, 12))
        bad = bearings_of_pixels(camera.parameters, pixels, bearings, jacobians)
        if bad >= 0:
            j, view = divmod(int(bad), 2)
            u, v = pixels[j, 2 * view : 2 * view + 2]
            raise InputError(
                f"pixels_{('initial', 'goal')[view]}: ({u:g}, {v:g}) at index {j} is outside the"
                f" camera's domain (at most {math.degrees(camera.usable_angle):.1f}° from the axis)"
            )
        return cls(camera.parameters, pixels, bearings, jacobians)

    def where(self, members: BoolArray) -> Matches:
        """Return the chosen rows."""
        if members.all():
            return self
        return Matches(self.parameters, self.pixels[members], self.bearings[members], self.jacobians[members])


@dataclass(frozen=True, eq=False)
class TwoViewFit:
    """The best minimum of the pixel cost over the members, and its rival."""

    members: BoolArray
    """(n,) matches in the cost"""
    costs: FloatArray
    """(2,) Σr² of the best minimum and of the best other one [px²]; infinite: none"""
    rotations: FloatArray
    """(2, 3, 3)"""
    translations: FloatArray
    """(2, 3)"""
    points: FloatArray
    """(members, 3), of the best minimum"""
    converged: bool


def fit_two_views(matches: Matches, kind: int, robust: bool) -> TwoViewFit | None:
    """Return the fit to all matches, or to those that agree; None where fewer than eight agree.

    Robust: few matches are first fitted all together; only if they do not agree, and always where they are
    many, the members come from sampling.
    """
    n = len(matches.pixels)
    everyone = np.ones(n, dtype=np.bool_)
    if not robust:
        return _fit(matches, everyone, kind, None)
    whole = None
    if n <= FEW_POINTS:
        whole = _fit(matches, everyone, kind, None)
        if _agree(whole, matches):
            return whole
    essential = np.empty((3, 3))
    _, inliers = find_consensus(matches.bearings, matches.jacobians, SAMPLE_THRESHOLD_PX, 1, essential)
    if inliers < LEAST_POINTS:
        return whole
    members = _members(matches, essential)
    if members.sum() < LEAST_POINTS:
        return whole
    if members.all() and whole is not None:
        return whole
    chosen = _fit(matches, members, kind, essential)
    if whole is not None and not _significant(whole, chosen):
        return whole
    return chosen


def _fit(matches: Matches, members: BoolArray, kind: int, prior: FloatArray | None) -> TwoViewFit:
    chosen = matches.where(members)
    many = len(chosen.pixels) > FEW_POINTS
    angles = np.array(START_ANGLES[: 1 if many else None])
    if many and prior is not None:
        angles = np.empty(0)
    priors = np.empty((0, 3, 3)) if prior is None else prior[None].copy()
    costs, rotations, translations, points, converged = motion_and_structure(
        chosen.parameters, chosen.pixels, chosen.bearings, chosen.jacobians, kind, angles, priors
    )
    return TwoViewFit(members, costs, rotations, translations, points[0], bool(converged))


def _agree(fit: TwoViewFit, matches: Matches) -> bool:
    """Tell whether no match lies beyond the gate of all, and σ is that of pixels and not of blunders."""
    if not math.isfinite(fit.costs[0]):
        return False
    distances, _ = _distances(matches, fit.rotations[0], fit.translations[0])
    sigma = _blended_noise(distances)
    return bool(np.abs(distances).max() <= GATE * sigma) and sigma <= SAMPLE_THRESHOLD_PX


def _members(matches: Matches, essential: FloatArray) -> BoolArray:
    """Return the matches near the epipolar geometry that a robust refinement makes of ``essential``."""
    rotation, translation = np.empty((3, 3)), np.empty(3)
    distances, weights = np.empty(len(matches.pixels)), np.empty(len(matches.pixels))
    sampson_distances(matches.bearings, matches.jacobians, essential, distances, weights)
    members = np.abs(distances) < SAMPLE_THRESHOLD_PX
    for _ in range(3):
        if members.sum() < LEAST_POINTS:
            break
        chosen = matches.where(members)
        sigma = _blended_noise(distances[members])
        if motion_in_front(chosen.bearings, essential, rotation, translation) < 0:
            break
        refine_epipolar(chosen.bearings, chosen.jacobians, 2.0 * sigma, rotation, translation, 20)
        distances, essential = _distances(matches, rotation, translation)
        sigma = _blended_noise(distances[members])
        near = np.abs(distances) <= GATE * sigma
        if (near == members).all():
            break
        members = near
    motion_in_front(matches.bearings[members], essential, rotation, translation)
    for j in np.flatnonzero(members).tolist():
        first, second = ray_distances(matches.bearings, j, rotation, translation)
        members[j] = first > 0.0 and second > 0.0
    return members


def _distances(
    matches: Matches, rotation: FloatArray, translation: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Return the Sampson distances (n,) [px] under a motion, and its essential matrix."""
    n = len(matches.pixels)
    essential, distances, weights = np.empty((3, 3)), np.empty(n), np.empty(n)
    essential_matrix(rotation, translation, essential)
    sampson_distances(matches.bearings, matches.jacobians, essential, distances, weights)
    return distances, essential


def _blended_noise(distances: FloatArray) -> float:
    """Return σ [px] from the median distance (so outliers do not enter) and the prior."""
    n = len(distances)
    robust = 1.4826 * float(np.median(np.abs(distances)))
    freedom = max(n - MOTION_PARAMETERS, 1)
    square = robust * robust * n
    return math.sqrt((PRIOR_WEIGHT * PRIOR_NOISE_PX**2 + square) / (PRIOR_WEIGHT + freedom))


def _significant(whole: TwoViewFit, chosen: TwoViewFit) -> bool:
    """F test: do the members fit better than all do, beyond what leaving out any few would bring?"""
    kept = int(chosen.members.sum())
    dropped = len(chosen.members) - kept
    freedom = kept - MOTION_PARAMETERS
    if not math.isfinite(whole.costs[0]) or dropped == 0:
        return dropped > 0
    gain = (whole.costs[0] - chosen.costs[0]) / dropped
    return bool(gain > fdtri(dropped, freedom, 1.0 - SIGNIFICANCE) * chosen.costs[0] / freedom)
