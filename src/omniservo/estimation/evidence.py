"""What the residuals allow to say: which status a fit deserves.

Models are compared by F tests on their reprojection errors. With σ² from the general model (n − 5 degrees of
freedom), a simpler model of p parameters is kept where

    (S_simple − S)/(n + 5 − p)  <  F_c(n + 5 − p, n − 5) · max(S/(n − 5), (0.01 px)²)

because then the pixels do not tell the general model from it. The floor stands for the fact that no pixel
is known better; without it, exact synthetic data would make rounding errors significant. A simpler model is
dropped all the same where S_simple exceeds (0.6 px)² χ²_c(2n − p): with nine points the F test alone would
believe in several pixels of noise before it believed in parallax.

Where the noise is stated, σ² is that (or what the residuals say, where that is more), F becomes χ² and the
second bound falls away.
"""

from __future__ import annotations

import math

import numpy as np
from scipy.special import chdtri, fdtri

from omniservo.estimation.degenerate_motion import (
    HOMOGRAPHY,
    IDENTITY,
    ROTATION,
    algebraic_map,
    refine_linear_map,
)
from omniservo.estimation.matches import Matches
from omniservo.estimation.motion_search import Minimum
from omniservo.estimation.two_view_estimate import Status
from omniservo.estimation.two_view_fit import MOTION_PARAMETERS, TwoViewFit

LEAST_NOISE_PX = 0.01
PLAUSIBLE_NOISE_PX = 0.6
LARGEST_NOISE_PX = 5.0
"""Pixels that leave a larger σ do not belong to one rigid scene seen by this camera."""
LARGEST_MISSTATEMENT = 3.0
"""likewise, as a multiple of the noise that is stated"""
CONFIDENCE = {"no_motion": 0.999, "pure_rotation": 0.999, "planar_points": 0.99}
"""Higher where no direction exists: the general model then takes the best of many, and F is too large."""


SIMPLER: tuple[tuple[int, int, Status, str], ...] = (
    (IDENTITY, 0, "no_motion", "both images are the same"),
    (ROTATION, 3, "pure_rotation", "a rotation without translation explains both images"),
    (HOMOGRAPHY, 8, "planar_points", "a plane explains both images; points off that plane are needed"),
)
"""(map, parameters, status, words), from the simplest."""

NEARLY_AS_LIKELY = 2.0 / 3.0
"""A rival minimum makes the answer ambiguous where its likelihood is at least this part of the best one's.
With σ unknown that is (S/S_rival)^((n−5)/2), else exp((S − S_rival)/2σ²)."""

FAR_ROTATION = math.radians(5.0)
FAR_DIRECTION = math.radians(20.0)
"""Minima nearer than both are one answer with an uncertainty."""


def judge(fit: TwoViewFit, matches: Matches) -> tuple[Status, str]:
    """Return the status of a fit and one sentence with its evidence; ("ok", "") where it is a pose."""
    members = matches.where(fit.members)
    n = len(members.pixels)
    freedom = n - MOTION_PARAMETERS
    cost = fit.cost
    variance = _variance(cost, freedom, members.noise_px)
    simple = _simpler_model(members, variance, cost)
    if simple is not None:
        return simple
    if not fit.minima or not fit.minima[0].converged:
        return "not_converged", "the refinement of motion and structure found no minimum"
    noise = math.sqrt(cost / freedom)
    if noise > largest_noise(members.noise_px):
        words = f"the best motion leaves {noise:.2g} px of noise"
        if members.noise_px is not None:
            words += f" where {members.noise_px:.2g} px is stated"
        return "not_converged", f"{words}: the matches do not agree"
    for rival in fit.minima[1:]:
        odds = _odds(cost, rival.cost, freedom, variance, members.noise_px)
        turn, swing = _separation(fit.minima[0], rival)
        if odds > NEARLY_AS_LIKELY and (turn > FAR_ROTATION or swing > FAR_DIRECTION):
            return "ambiguous", (
                f"two motions {math.degrees(turn):.1f}° (rotation) and {math.degrees(swing):.1f}° (direction)"
                f" apart fit with rms {_rms(cost, n):.3f} and {_rms(rival.cost, n):.3f} px: more points or"
                " sharper pixels are needed"
            )
    return "ok", ""


def largest_noise(stated: float | None) -> float:
    """Return the σ [px] beyond which pixels do not belong to one rigid scene seen by this camera."""
    return LARGEST_NOISE_PX if stated is None else LARGEST_MISSTATEMENT * stated


def _variance(cost: float, freedom: int, stated: float | None) -> float:
    """Return σ² [px²] of a coordinate of weight 1: from the residuals, but never below what is known."""
    if not math.isfinite(cost):
        return 100.0 * LEAST_NOISE_PX**2 if stated is None else stated**2
    return max(cost / freedom, (LEAST_NOISE_PX if stated is None else stated) ** 2)


def _odds(cost: float, rival: float, freedom: int, variance: float, stated: float | None) -> float:
    """Return how likely a rival minimum is beside the best one."""
    if stated is not None:
        return math.exp(0.5 * (cost - rival) / variance)
    floor = LEAST_NOISE_PX**2 * freedom
    return math.pow(max(cost, floor) / max(rival, floor), 0.5 * freedom)


def _simpler_model(members: Matches, variance: float, cost: float) -> tuple[Status, str] | None:
    n = len(members.pixels)
    freedom = n - MOTION_PARAMETERS
    for kind, parameters, status, words in SIMPLER:
        matrix = algebraic_map(members.bearings, kind)
        simple = refine_linear_map(
            members.parameters,
            members.pixels,
            members.weights,
            members.bearings,
            members.jacobians,
            kind,
            matrix,
        )
        extra = n + MOTION_PARAMETERS - parameters
        chance = 1.0 - CONFIDENCE[status]
        if members.noise_px is None:
            bound = extra * float(fdtri(extra, freedom, 1.0 - chance)) * variance
            plausible = PLAUSIBLE_NOISE_PX**2 * float(chdtri(2 * n - parameters, chance))
        else:
            bound, plausible = float(chdtri(extra, chance)) * variance, math.inf
        if simple < plausible and simple - min(cost, simple) < bound:
            return (
                status,
                f"{words} (rms {_rms(simple, n):.3f} px; with motion and structure {_rms(cost, n):.3f})",
            )
    return None


def _rms(cost: float, n: int) -> float:
    return math.sqrt(cost / (2 * n))


def _separation(one: Minimum, other: Minimum) -> tuple[float, float]:
    """Return the angles between two minima's rotations and directions [rad]."""
    chord = float(np.linalg.norm(one.rotation - other.rotation))
    turn = 2.0 * math.asin(min(1.0, chord / math.sqrt(8.0)))
    swing = math.acos(max(-1.0, min(1.0, float(one.translation @ other.translation))))
    return turn, swing
