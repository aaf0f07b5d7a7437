"""What the residuals of known points allow to say: which status a pose deserves.

With σ unknown and ν = 2n − 6 degrees of freedom, a second minimum of cost S' is (S/S')^(ν/2) times as likely
as the best one of cost S; with σ stated exp((S − S')/2σ²). Where ν ≤ 2 the residuals say too little about σ:
they are joined with a prior of 0.5 px, worth four of them, and the odds are ((1 + S)/(1 + S'))^(2 + ν/2) with
S in px².

Points left out make a pose doubtful. That k of n points agree as well with some pose by chance is to be
expected C(n, 3) · 4 · C(n − 3, k − 3) · p^(k − 3) times, p the part of the image that the points cover within
the largest distance of the k from their pixels, k/(k − 3) times its square since the pose was fitted to them
(an a-contrario bound: Moisan, Stival 2004). Few points must moreover be the clear majority, and those left
out must not hold a pose of their own.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from scipy.special import chdtri

from omniservo.estimation.pose_estimate import PoseStatus
from omniservo.estimation.refinement.motion_search import LEAST_NOISE_PX
from omniservo.estimation.robust.pose_fit import CHECKED_POINTS, FEW_POINTS, KnownPixels, PoseFit, fit_pose
from omniservo.estimation.robust.pose_search import PRIOR_NOISE_PX, PRIOR_WEIGHT, pose_score
from omniservo.estimation.status.evidence import largest_noise
from omniservo.geometry.arrays import FloatArray
from omniservo.geometry.false_alarms import false_alarms

NEARLY_AS_LIKELY = 0.1
"""A far minimum that is at least so likely beside the best one makes the answer ambiguous."""

NEGLIGIBLE = 1e-3
"""Minima less likely than this are not reported."""

FAR_ROTATION = math.radians(5.0)
"""Minima nearer than this are one answer with an uncertainty."""

FALSE_ALARMS = 1e-3
"""Most poses that chance may be expected to offer with as many points as near their pixels."""

LEAST_PART = 0.6
"""of the points must agree where they are fewer than twelve"""

SIGNIFICANCE = 1e-3
"""Residuals overrule a stated σ where chance makes them so large less often than this."""

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
    refused = refusal(fit, known)
    if refused is not None and not len(fit.minima):
        return PoseVerdict(*refused, math.nan, math.nan, np.empty(0))
    cost, freedom = float(fit.costs[0]), 2 * int(fit.members.sum()) - 6
    variance = variance_of(cost, freedom, known.noise_px)
    noise = noise_of(cost, freedom, known.noise_px)
    odds = odds_of(fit.costs, freedom, known.noise_px)
    odds = odds[odds >= NEGLIGIBLE]
    if refused is not None:
        return PoseVerdict(*refused, variance, noise, odds if refused[0] == "ambiguous" else odds[:0])
    rival = far_rival(fit, odds)
    if rival is not None:
        return PoseVerdict("ambiguous", rival, variance, noise, odds)
    return PoseVerdict("ok", "", variance, noise, odds)


def refusal(fit: PoseFit, known: KnownPixels) -> tuple[PoseStatus, str] | None:
    """Return status and evidence where a fit is no pose, whatever other minima there are; None: it may be."""
    n, k = len(fit.members), int(fit.members.sum())
    if fit.is_collinear:
        return "collinear_points", f"the {k} points lie on one line: the camera could stand around it"
    if n >= CHECKED_POINTS > k:
        return "not_converged", f"no pose brings {CHECKED_POINTS} of the {n} points near their pixels"
    if not len(fit.minima):
        return "not_converged", "no pose brings the points to their pixels, or many do"
    noise = noise_of(float(fit.costs[0]), 2 * k - 6, known.noise_px)
    if noise > largest_noise(known.noise_px):
        return "not_converged", f"the best pose leaves {noise:.2g} px of noise: the points do not agree"
    few = k < FEW_POINTS and k < LEAST_PART * n
    if k < n and (few or chance_poses(fit, known) > FALSE_ALARMS):
        return "not_converged", f"only {k} of the {n} points agree, which chance could bring about"
    if n - k >= max(CHECKED_POINTS, RIVAL_PART * k):
        others = known.where(~fit.members)
        rival = fit_pose(others, True)
        support = int(rival.members.sum()) if len(rival.minima) else 0
        if support >= RIVAL_PART * k and chance_poses(rival, others) <= FALSE_ALARMS:
            return (
                "ambiguous",
                f"{k} of the {n} points agree with one pose, {support} others with another one",
            )
    return None


def far_rival(fit: PoseFit, odds: FloatArray) -> str | None:
    """Return the evidence that a minimum far from the best is nearly as likely; None where none is."""
    for minimum, likely in zip(fit.minima[1:], odds[1:], strict=False):
        turn = rotation_between(fit.minima[0], minimum)
        if likely > NEARLY_AS_LIKELY and turn > FAR_ROTATION:
            return f"a pose {math.degrees(turn):.1f}° away is {likely:.2g} times as likely as the best"
    return None


def noise_of(cost: float, freedom: int, stated: float | None) -> float:
    """Return σ [px] of a coordinate of weight 1 as the residuals tell; where there are none, as stated."""
    if freedom > 0:
        return math.sqrt(cost / freedom)
    return PRIOR_NOISE_PX if stated is None else stated


def variance_of(cost: float, freedom: int, stated: float | None) -> float:
    """Return σ² [px²] for covariances: stated, or more where the residuals prove it; else Student's t."""
    if stated is not None:
        more = freedom > 0 and cost > stated**2 * float(chdtri(freedom, SIGNIFICANCE))
        return cost / freedom if more else stated**2
    if freedom > 2:
        return cost / (freedom - 2)
    return (PRIOR_WEIGHT * PRIOR_NOISE_PX**2 + cost) / (PRIOR_WEIGHT + freedom - 2)


def odds_of(costs: FloatArray, freedom: int, stated: float | None) -> FloatArray:
    """Return how likely each minimum is beside the first, the best one, by their costs (m,) [px²]."""
    if stated is not None:
        return np.asarray(np.exp(0.5 * (costs[0] - costs) / variance_of(float(costs[0]), freedom, stated)))
    if freedom > 2:
        floored = np.maximum(costs, LEAST_NOISE_PX**2 * freedom)
        return np.asarray((floored[0] / floored) ** (0.5 * freedom))
    prior = PRIOR_WEIGHT * PRIOR_NOISE_PX**2
    return np.asarray(((prior + costs[0]) / (prior + costs)) ** (0.5 * (PRIOR_WEIGHT + freedom)))


def rotation_between(one: FloatArray, other: FloatArray) -> float:
    """Return the angle [rad] between two poses that begin with a quaternion."""
    return 2.0 * math.acos(min(1.0, abs(float(one[:4] @ other[:4]))))


def chance_poses(fit: PoseFit, known: KnownPixels) -> float:
    """Return how many poses agree as well with as many points, to be expected of points that have none."""
    n, k = len(fit.members), int(fit.members.sum())
    squares, best = np.empty(n), fit.minima[0]
    pose_score(
        known.parameters, known.points, known.pixels, known.weights, math.inf, best[:4], best[4:7], squares
    )
    width, height = np.maximum(np.ptp(known.pixels, axis=0), 1.0)
    square = max(float(squares[fit.members].max()), LEAST_NOISE_PX**2) * k / (k - 3)
    part = min(1.0, math.pi * square / float(width * height))
    return false_alarms(n, k, 3, part, 4.0)
