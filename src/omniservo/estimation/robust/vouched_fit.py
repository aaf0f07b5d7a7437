"""Members that agree with a motion only because it bends to them.

Where the others leave a motion nearly free in some direction, it can satisfy a wrong match as well, and no
residual tells. With A = ∂d/∂motion of the members' Sampson distances d and h = aᵀ(AᵀA)⁻¹a the leverage of a
row a (between 0 and 1, of sum 5), the others alone put that match at d/(1 − h), with a standard deviation of
σ/√(1 − h). It is wrong rather than right by odds of

    w · (1/extent) / N(d/(1 − h); 0, σ²/(1 − h))

w the odds of wrong matches beside it: those of one thing stand together, as the corners of a tag do.
"""

from __future__ import annotations

import math

import numpy as np
from scipy.spatial import cKDTree

from omniservo.estimation.matches import Matches
from omniservo.estimation.refinement.epipolar_refinement import essential_matrix, sampson_row, tangent_plane
from omniservo.estimation.refinement.motion_search import LEAST_NOISE_PX
from omniservo.estimation.robust.members import MOTION_PARAMETERS
from omniservo.estimation.robust.two_view_fit import EIGHT_POINTS, THING, TwoViewFit, fit_members
from omniservo.geometry.arrays import BoolArray, FloatArray
from omniservo.geometry.kernel import kernel
from omniservo.geometry.linear_systems import factor_cholesky, solve_factored

DECISIVE = 0.5
"""A leverage: beyond, a match says more about its own place than all the others do."""

DOUBTFUL = 5e-3
"""A decisive member is left out where its odds to be wrong are larger."""

BESIDE = THING - 1
"""Matches are judged by so many nearest to them, in either image."""


def vouched_fit(matches: Matches, fit: TwoViewFit, kind: int) -> TwoViewFit | None:
    """Return the fit to the members that agree with the others; None: fewer than eight are left.

    Only where wrong matches were found. One of many may be decisive, too: where its rays meet close to a
    camera the motion of all others is nearly free to bend to it.
    """
    while fit.minima and not fit.members.all():
        inside, best = int(fit.members.sum()), fit.minima[0]
        if inside < EIGHT_POINTS:
            return None
        distances, shares = np.empty(inside), np.empty(inside)
        if not leverages(matches.where(fit.members), best.rotation, best.translation, distances, shares):
            return fit
        if shares.max() <= DECISIVE:
            return fit
        sigma = max(math.sqrt(fit.cost / (inside - MOTION_PARAMETERS)), matches.noise_px, LEAST_NOISE_PX)
        spread = sigma / np.sqrt(1.0 - shares)
        away = distances / ((1.0 - shares) * spread)
        density = np.exp(-0.5 * np.square(away)) / (math.sqrt(2.0 * math.pi) * spread)
        extent = max(float(np.hypot(*np.ptp(matches.pixels[:, 2:], axis=0))), 1.0)
        odds = odds_beside(matches, fit.members)[fit.members] / (extent * np.maximum(density, 1e-300))
        worst = int(np.argmax(np.where(shares > DECISIVE, odds, 0.0)))
        if odds[worst] <= DOUBTFUL:
            return fit
        members, essential = fit.members.copy(), np.empty((3, 3))
        members[np.flatnonzero(members)[worst]] = False
        essential_matrix(best.rotation, best.translation, essential)
        fit = fit_members(matches, members, kind, essential)
    return fit


def odds_beside(matches: Matches, members: BoolArray) -> FloatArray:
    """Return the odds (n,) of a match to be wrong: as its nearest ones have it, or all of them, if larger."""
    wrong, inside, own = np.zeros(matches.size), int(members.sum()), np.arange(matches.size)[:, None]
    for image in (matches.pixels[:, :2], matches.pixels[:, 2:]):
        nearest = cKDTree(image).query(image, THING)[1]  # with itself, mostly
        beside = ((~members)[nearest] & (nearest != own)).sum(axis=1)
        wrong = np.maximum(wrong, np.minimum(beside, BESIDE))
    return np.maximum((wrong + 0.5) / (BESIDE - wrong + 0.5), (matches.size - inside) / inside)


@kernel
def leverages(
    matches: Matches,
    rotation: FloatArray,
    translation: FloatArray,
    distances: FloatArray,
    shares: FloatArray,
) -> bool:
    """Write the Sampson distances d (n,) [px] and leverages h (n,); False where the motion stays free."""
    n, p = distances.shape[0], MOTION_PARAMETERS
    rows, normal, solved = np.empty((n, p)), np.zeros((p, p)), np.empty(p)
    essential, tangents = np.empty((3, 3)), np.empty((2, 3))
    essential_matrix(rotation, translation, essential)
    tangent_plane(translation, tangents)
    for j in range(n):
        distances[j] = sampson_row(
            matches.bearings, matches.jacobians, j, rotation, essential, tangents, rows[j]
        )
        for i in range(p):
            for k in range(i + 1):
                normal[i, k] += rows[j, i] * rows[j, k]
    if not factor_cholesky(normal, p, 1e-15):
        return False
    for j in range(n):
        solved[:] = rows[j]
        solve_factored(normal, p, solved)
        shares[j] = 0.0
        for i in range(p):
            shares[j] += rows[j, i] * solved[i]
        shares[j] = min(max(shares[j], 0.0), 1.0 - 1e-12)
    return True
