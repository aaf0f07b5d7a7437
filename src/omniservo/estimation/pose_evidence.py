"""What the residuals of known points allow to say: which status a pose deserves.

With σ unknown and ν = 2n − 6 degrees of freedom, a second minimum of cost S' is (S/S')^(ν/2) times as likely
as the best one of cost S; with σ stated exp((S − S')/2σ²). Where ν ≤ 2 the residuals say too little about σ:
they are joined with a prior of 0.5 px, worth four of them, and the odds are ((1 + S)/(1 + S'))^(2 + ν/2) with
S in px².

Points left out make a pose doubtful. That k of n points lie within the gate of some pose by chance is to be
expected C(n, 3) · 4 · C(n − 3, k − 3) · p^(k − 3) times, p the gate's part of the image that the points cover
(an a-contrario bound: Moisan, Stival 2004); and those left out must not hold a pose of their own.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from scipy.special import gammaln

from omniservo.estimation.evidence import LEAST_NOISE_PX, largest_noise
from omniservo.estimation.pose_estimate import PoseStatus
from omniservo.estimation.pose_fit import CHECKED_POINTS, KnownPixels, PoseFit, fit_pose
from omniservo.estimation.pose_search import GATE, PRIOR_NOISE_PX, PRIOR_WEIGHT
from omniservo.geometry.arrays import FloatArray

NEARLY_AS_LIKELY = 0.1
"""A far minimum that is at least so likely beside the best one makes the answer ambiguous."""

NEGLIGIBLE = 1e-3
"""Minima less likely than this are not told."""

FAR_ROTATION = math.radians(5.0)
"""Minima nearer than this are one answer with an uncertainty."""

FALSE_ALARMS = 1e-5
"""Most poses that chance may be expected to offer with as many points; few, since a pose that is refined is
more than one try."""

RIVAL_PART = 0.6
"""A pose of the points left out rivals one that has at most this much more support."""


@dataclass(frozen=True, eq=False)
class PoseVerdict:
    """Status with its evidence, and the minima that count."""

    status: PoseStatus
    message: str
    variance: float
    """σ² of a coordinate of weight 1 for the covariance [px²]"""
    noise_px: float
    """σ from the residuals [px]"""
    odds: FloatArray
    """(m,) of the first m minima, those that are not negligible"""


def judge_pose(fit: PoseFit, known: KnownPixels) -> PoseVerdict:
    """Return what a fit is worth."""
    n, k = len(fit.members), int(fit.members.sum())
    if fit.is_collinear:
        return _no("collinear_points", f"the {k} points lie on one line: the camera could stand around it")
    if n >= CHECKED_POINTS > k:
        return _no("not_converged", f"no pose brings {CHECKED_POINTS} of the {n} points near their pixels")
    if not len(fit.minima):
        return _no("not_converged", "no pose brings the points to their pixels, or many do")
    cost, freedom = float(fit.minima[0, 7]), 2 * k - 6
    noise = noise_of(cost, freedom, known.noise_px)
    if noise > largest_noise(known.noise_px):
        return _no("not_converged", f"the best pose leaves {noise:.2g} px of noise: the points do not agree")
    if k < n and chance_poses(known, k) > FALSE_ALARMS:
        return _no("not_converged", f"only {k} of the {n} points agree, which chance could bring about")
    odds = np.array([_odds(cost, float(c), freedom, known.noise_px) for c in fit.minima[:, 7]])
    odds = odds[odds >= NEGLIGIBLE]
    variance = variance_of(cost, freedom, known.noise_px)
    verdict = PoseVerdict("ok", "", variance, noise, odds)
    for rival in range(1, len(odds)):
        turn = rotation_between(fit.minima[0], fit.minima[rival])
        if odds[rival] > NEARLY_AS_LIKELY and turn > FAR_ROTATION:
            words = f"a pose {math.degrees(turn):.1f}° away is {odds[rival]:.2g} times as likely as the best"
            return PoseVerdict("ambiguous", words, variance, noise, odds)
    if n - k >= max(CHECKED_POINTS, RIVAL_PART * k):
        others = known.where(~fit.members)
        rival_fit = fit_pose(others, True)
        support = int(rival_fit.members.sum()) if len(rival_fit.minima) else 0
        if support >= RIVAL_PART * k and chance_poses(others, support) <= FALSE_ALARMS:
            words = f"{k} of the {n} points agree with one pose, {support} others with another one"
            return PoseVerdict("ambiguous", words, variance, noise, odds)
    return verdict


def noise_of(cost: float, freedom: int, stated: float | None) -> float:
    """Return σ [px] of a coordinate of weight 1 as the residuals tell; where there are none, as stated."""
    if freedom > 0:
        return math.sqrt(cost / freedom)
    return PRIOR_NOISE_PX if stated is None else stated


def variance_of(cost: float, freedom: int, stated: float | None) -> float:
    """Return σ² [px²] for covariances: stated, or more where the residuals say so; else Student's t."""
    if stated is not None:
        return max(stated**2, cost / freedom if freedom > 0 else 0.0)
    if freedom > 2:
        return cost / (freedom - 2)
    return (PRIOR_WEIGHT * PRIOR_NOISE_PX**2 + cost) / (PRIOR_WEIGHT + freedom - 2)


def rotation_between(one: FloatArray, other: FloatArray) -> float:
    """Return the angle [rad] between two poses that begin with a quaternion."""
    return 2.0 * math.acos(min(1.0, abs(float(one[:4] @ other[:4]))))


def chance_poses(known: KnownPixels, agreeing: int) -> float:
    """Return how many poses with so many agreeing points are to be expected of points without any."""
    n = len(known.points)
    width, height = np.maximum(np.ptp(known.pixels, axis=0), 1.0)
    gate = GATE * (PRIOR_NOISE_PX if known.noise_px is None else known.noise_px)
    part = min(1.0, math.pi * gate**2 / float(width * height))
    tries = math.log(4.0) + _log_choose(n, 3)
    return math.exp(min(tries + _log_choose(n - 3, agreeing - 3) + (agreeing - 3) * math.log(part), 50.0))


def _log_choose(n: int, k: int) -> float:
    return float(gammaln(n + 1) - gammaln(k + 1) - gammaln(n - k + 1))


def _odds(cost: float, rival: float, freedom: int, stated: float | None) -> float:
    """Return how likely a minimum is beside the best one."""
    if stated is not None:
        return math.exp(0.5 * (cost - rival) / variance_of(cost, freedom, stated))
    if freedom > 2:
        floor = LEAST_NOISE_PX**2 * freedom
        return math.pow(max(cost, floor) / max(rival, floor), 0.5 * freedom)
    prior = PRIOR_WEIGHT * PRIOR_NOISE_PX**2
    return math.pow((prior + cost) / (prior + rival), 0.5 * (PRIOR_WEIGHT + freedom))


def _no(status: PoseStatus, message: str) -> PoseVerdict:
    return PoseVerdict(status, message, math.nan, math.nan, np.empty(0))
