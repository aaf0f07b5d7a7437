"""What the residuals allow to say: which status a fit deserves.

Models are compared by F tests on their reprojection errors. With σ² from the general model (n − 5 degrees of
freedom), a simpler model of p parameters is kept where

    (S_simple − S)/(n + 5 − p)  <  F₀.₉₉(n + 5 − p, n − 5) · max(S/(n − 5), (0.01 px)²)

because then the pixels do not tell the general model from it. The floor stands for the fact that no pixel
is known better; without it, exact synthetic data would make rounding errors significant.
"""

from __future__ import annotations

import math

import numpy as np
from scipy.special import fdtri

from omniservo.estimation.degenerate_motion import HOMOGRAPHY, IDENTITY, ROTATION, fit_linear_map
from omniservo.estimation.two_view_estimate import Status
from omniservo.estimation.two_view_fit import (
    LARGEST_NOISE_PX,
    MOTION_PARAMETERS,
    Matches,
    TwoViewFit,
)
from omniservo.geometry.arrays import FloatArray

LEAST_NOISE_PX = 0.01
CONFIDENCE = 0.99

SIMPLER: tuple[tuple[int, int, Status, str], ...] = (
    (IDENTITY, 0, "no_motion", "both images are the same"),
    (ROTATION, 3, "pure_rotation", "a rotation without translation explains both images"),
    (HOMOGRAPHY, 8, "planar_points", "a plane explains both images; points off that plane are needed"),
)
"""(map, parameters, status, words), from the simplest."""

NEARLY_AS_LIKELY = 2.0 / 3.0
"""A rival minimum makes the answer ambiguous where its likelihood is at least this part of the best one's.
With σ unknown that is (S/S_rival)^((n−5)/2)."""

FAR_ROTATION = math.radians(5.0)
FAR_DIRECTION = math.radians(20.0)
"""Minima nearer than both are one answer with an uncertainty."""


def judge(fit: TwoViewFit, matches: Matches) -> tuple[Status, str]:
    """Return the status of a fit and one sentence with its evidence; ("ok", "") where it is a pose."""
    members = matches.where(fit.members)
    n = len(members.pixels)
    freedom = n - MOTION_PARAMETERS
    cost = float(fit.costs[0])
    floor = LEAST_NOISE_PX**2 * freedom
    simple = _simpler_model(members, max(cost, floor) if math.isfinite(cost) else 100.0 * floor, cost)
    if simple is not None:
        return simple
    if not math.isfinite(cost) or not fit.converged:
        return "not_converged", "the refinement of motion and structure found no minimum"
    noise = math.sqrt(cost / freedom)
    if noise > LARGEST_NOISE_PX:
        return "not_converged", f"the best motion leaves {noise:.1f} px of noise: the matches do not agree"
    rival = float(fit.costs[1])
    odds = (max(cost, floor) / max(rival, floor)) ** (0.5 * freedom) if math.isfinite(rival) else 0.0
    if odds > NEARLY_AS_LIKELY:
        turn, swing = _separation(fit)
        if turn > FAR_ROTATION or swing > FAR_DIRECTION:
            return "ambiguous", (
                f"two motions {math.degrees(turn):.1f}° (rotation) and {math.degrees(swing):.1f}° (direction)"
                f" apart fit with rms {_rms(cost, n):.3f} and {_rms(rival, n):.3f} px: more points or"
                " sharper pixels are needed"
            )
    return "ok", ""


def _simpler_model(members: Matches, variance_sum: float, cost: float) -> tuple[Status, str] | None:
    n = len(members.pixels)
    freedom = n - MOTION_PARAMETERS
    matrix = np.empty((3, 3))
    for kind, parameters, status, words in SIMPLER:
        simple = fit_linear_map(
            members.parameters, members.pixels, members.bearings, members.jacobians, kind, matrix
        )
        extra = n + MOTION_PARAMETERS - parameters
        bound = float(fdtri(extra, freedom, CONFIDENCE)) * variance_sum / freedom
        if (simple - min(cost, simple)) / extra < bound:
            return (
                status,
                f"{words} (rms {_rms(simple, n):.3f} px; with motion and structure {_rms(cost, n):.3f})",
            )
    return None


def _rms(cost: float, n: int) -> float:
    return math.sqrt(cost / (2 * n))


def _separation(fit: TwoViewFit) -> tuple[float, float]:
    """Return the angles between the two minima's rotations and directions [rad]."""
    chord: FloatArray = fit.rotations[0] - fit.rotations[1]
    turn = 2.0 * math.asin(min(1.0, float(np.linalg.norm(chord)) / math.sqrt(8.0)))
    swing = math.acos(max(-1.0, min(1.0, float(fit.translations[0] @ fit.translations[1]))))
    return turn, swing
