"""What the residuals allow to say: which status a fit deserves.

Models are compared by F tests on their reprojection errors. With σ² from the general model (n − 5 degrees of
freedom), a simpler model of p parameters is kept where

    (S_simple − S)/(n + 5 − p)  <  F_c(n + 5 − p, n − 5) · max(S/(n − 5), (0.01 px)²)

because then the pixels do not tell the general model from it. The floor stands for the fact that no pixel
is known better; without it, exact synthetic data would make rounding errors significant. A simpler model is
dropped all the same where S_simple exceeds (0.6 px)² χ²_c(2n − p): with nine points the F test alone would
assume several pixels of noise before it assumed parallax.

Where the noise is stated, σ² is that (or what the residuals say, where that is more), F becomes χ² and the
second bound falls away.

For a plane σ² grows by (0.05 px)²: the errors of features of one plane seen at a slant are alike side by
side, as parallax is, and do not average out.

Wrong matches can pretend parallax: a motion that a plane (a rotation, nothing) leaves half free bends to a
few of them. So where nearly all matches obey a simpler model, k of the m others agree with the motion, and
the model explains the members without those as well, the motion stands only if chance does not explain that:
C(m, 2) P(X ≥ k − 2) < 10⁻³, X binomial, those of m − 2 in the epipolar band; two of them can always be had.

- Of all that disobey the model: wrong matches lie anywhere in the image, and (f/(1 − f))ᵏ is a factor, f the
  share of wrong matches, since little relief does as well.
- Of those `FAR` from the model, which little relief does not explain: r [px] off it in any direction, a match
  lies in the band of half width g with the chance (2/π) asin(g/r). X has the mean of those, without the two
  farthest: its tail is no thinner than theirs (Hoeffding 1956). Of a plane it is 2 P(X ≥ k), X of all m: the
  plane leaves two motions, and no part of them free.

Whether the matches come from this camera and from one rigid scene: `camera_evidence`; whether they are found
well enough: `heavy_tails`.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from functools import lru_cache

import numpy as np
from scipy.special import bdtrc, chdtri, fdtri

from omniservo.estimation.matches import Matches
from omniservo.estimation.refinement.motion_search import FEW_POINTS, LEAST_NOISE_PX, Minimum
from omniservo.estimation.robust.map_consensus import bulk_maps
from omniservo.estimation.robust.members import GATE, MOTION_PARAMETERS
from omniservo.estimation.robust.two_view_fit import EIGHT_POINTS, SIGNIFICANCE, TwoViewFit
from omniservo.estimation.status.camera_evidence import foreign_evidence
from omniservo.estimation.status.degenerate_motion import HOMOGRAPHY, IDENTITY, ROTATION, simpler_costs
from omniservo.estimation.status.heavy_tails import badly_found
from omniservo.estimation.two_view_estimate import Status
from omniservo.estimation.uncertainty.two_view_uncertainty import Lens
from omniservo.geometry.arrays import FloatArray

PLAUSIBLE_NOISE_PX = 0.6
LARGEST_NOISE_PX = 5.0
"""Pixels that leave a larger σ do not belong to one rigid scene seen by this camera."""
LARGEST_MISSTATEMENT = 3.0
"""likewise, as a multiple of the noise that is stated"""
CONFIDENCE: Mapping[Status, float] = {
    "no_motion": 1.0 - 1e-5,
    "pure_rotation": 1.0 - 1e-5,
    "planar_points": 0.999,
}
"""Higher where no direction exists: the general model then takes the best of many, and F is too large."""


SHARED_PX = 0.05
"""σ [px] by which features of one plane seen at a slant may err alike; parallax must be beyond this too"""

SIMPLER: tuple[tuple[int, int, Status, str], ...] = (
    (IDENTITY, 0, "no_motion", "both images are the same"),
    (ROTATION, 3, "pure_rotation", "a rotation without translation explains both images"),
    (
        HOMOGRAPHY,
        8,
        "planar_points",
        "a plane explains both images; points off that plane are needed, or the planar method",
    ),
)
"""(map, parameters, status, words), from the simplest."""

FAR = 3.0
"""[gates] from a simpler model, that little relief does not explain"""

NEARLY_AS_LIKELY = 2.0 / 3.0
"""A rival minimum makes the answer ambiguous where its likelihood is at least this part of the best one's.
With σ unknown that is (S/S_rival)^((n−5)/2), else exp((S − S_rival)/2σ²)."""

BEYOND_ELLIPSOID = math.radians(60.0)
UNLIKELY = 0.01
"""Nearer rivals are held by the covariance, which they stretch. One whose direction is farther off no
ellipsoid about the best direction can hold: then it must be less likely than this,"""

MANY = 2 * EIGHT_POINTS
"""where there are so many members. Of fewer most have such a rival, and the law's long tails reach it."""

VERY_UNLIKELY = 1e-3
"""likewise of more than `FEW_POINTS` members, of which hardly any have such a rival"""

FAR_ROTATION = math.radians(5.0)
FAR_DIRECTION = math.radians(20.0)
"""Minima nearer than both are one answer with an uncertainty."""

OTHER_ROTATION = math.radians(1.0)
OTHER_DIRECTION = math.radians(5.0)
"""likewise of fits to different members; smaller, because no uncertainty reaches from one to the other"""


def judge(fit: TwoViewFit, matches: Matches, robust: bool, lens: Lens) -> tuple[Status, str]:
    """Return the status of a fit and one sentence with its evidence; ("ok", "") where it is a pose.

    ``lens`` has the camera's model error: no residuals tell of less noise, since motion and structure take
    most of it up, and neighbours within it may be alike.
    """
    members = matches.where(fit.members)
    freedom = members.size - MOTION_PARAMETERS
    variance = max(noise_variance(fit.cost, freedom, members.noise_px), lens.sigma_px**2)
    simple = simpler_model(members, variance, fit.cost)
    if simple is None and robust and matches.size >= EIGHT_POINTS:
        simple = _bulk_model(fit, matches, variance)
    if simple is not None:
        return simple
    if not fit.minima or not fit.minima[0].converged:
        return "not_converged", "the refinement of motion and structure found no minimum"
    noise = math.sqrt(fit.cost / max(freedom, 1))
    if noise > largest_noise(members.noise_px):
        words = f"the best motion leaves {noise:.2g} px of noise"
        if members.noise_px > 0.0:
            words += f" where {members.noise_px:.2g} px is stated"
        return "not_converged", f"{words}: the matches do not agree"
    found = math.sqrt(noise_variance(fit.cost, freedom, members.noise_px))
    foreign = foreign_evidence(fit, matches, math.sqrt(variance), lens)
    against = foreign or badly_found(matches, fit, found)
    if against is not None:
        return "not_converged", against
    return _rival(fit, members, variance) or _other_members(fit) or ("ok", "")


def is_only_noisier(fit: TwoViewFit, matches: Matches, lens: Lens) -> bool:
    """Tell whether a fit is refused for nothing but noise that is stated too small."""
    if not fit.minima or not fit.minima[0].converged:
        return False
    sigma = math.sqrt(noise_variance(fit.cost, int(fit.members.sum()) - MOTION_PARAMETERS, matches.noise_px))
    foreign = foreign_evidence(fit, matches, sigma, lens)
    return foreign is None and badly_found(matches, fit, sigma) is not None


def largest_noise(stated: float | None) -> float:
    """Return the σ [px] beyond which pixels do not belong to one rigid scene seen by this camera."""
    return LARGEST_MISSTATEMENT * stated if stated else LARGEST_NOISE_PX


def noise_variance(cost: float, freedom: int, stated: float) -> float:
    """Return σ² [px²] of a coordinate of weight 1: from the residuals, but never below what is known."""
    if not math.isfinite(cost):
        return stated**2 if stated > 0.0 else 100.0 * LEAST_NOISE_PX**2
    return max(cost / max(freedom, 1), (stated if stated > 0.0 else LEAST_NOISE_PX) ** 2)


def simpler_model(
    members: Matches, variance: float, cost: float, confidence: Mapping[Status, float] = CONFIDENCE
) -> tuple[Status, str] | None:
    """Return the simplest model that explains the members as well as motion and structure do."""
    n = members.size
    limits = np.empty(3)
    for kind, parameters, status, _ in SIMPLER:
        if kind == HOMOGRAPHY:
            variance += SHARED_PX**2
        extra, chance = n + MOTION_PARAMETERS - parameters, 1.0 - confidence[status]
        if members.noise_px > 0.0:
            limits[kind] = cost + _chi_square(extra, chance) * variance
        else:
            bound = extra * _fisher(extra, n - MOTION_PARAMETERS, chance) * variance
            limits[kind] = min(cost + bound, PLAUSIBLE_NOISE_PX**2 * _chi_square(2 * n - parameters, chance))
    costs = simpler_costs(members, limits)
    for kind, _, status, words in SIMPLER:
        if costs[kind] < limits[kind]:
            rms = f"rms {_rms(costs[kind], n):.3f} px; with motion and structure {_rms(cost, n):.3f}"
            return status, f"{words} ({rms})"
    return None


@lru_cache(maxsize=4096)
def _chi_square(freedom: int, chance: float) -> float:
    """Return what χ² exceeds by this chance."""
    return float(chdtri(freedom, chance))


@lru_cache(maxsize=4096)
def _fisher(extra: int, freedom: int, chance: float) -> float:
    """Return what F exceeds by this chance."""
    return float(fdtri(extra, freedom, 1.0 - chance))


def _bulk_model(fit: TwoViewFit, matches: Matches, variance: float) -> tuple[Status, str] | None:
    """Return the simplest model that nearly all matches obey, where the others may be wrong matches."""
    n, inside = matches.size, int(np.count_nonzero(fit.members))
    gate, wrong = GATE * math.sqrt(variance + SHARED_PX**2), (n - inside + 1) / (n + 2)
    extent = max(math.hypot(*np.ptp(matches.pixels[:, 2:], axis=0)), 1.0)
    for (kind, _, status, words), apart in zip(SIMPLER, bulk_maps(matches, fit.members, gate), strict=True):
        for reach in (1.0, FAR):
            off = ~(apart < reach * gate)
            m, k = int(np.count_nonzero(off)), int(np.count_nonzero(off & fit.members))
            if k == inside:
                continue
            if reach < FAR:
                chance = (wrong / (1.0 - wrong)) ** k * _bent_to(k, m, min(1.0, 4.0 * gate / extent))
            elif kind == HOMOGRAPHY:
                chance = 2.0 * float(bdtrc(k - 1, m, _in_band(apart[off], gate))) if k else 1.0
            else:
                chance = _bent_to(k, m, _in_band(np.sort(apart[off])[:-2], gate))
            if chance <= SIGNIFICANCE:
                continue
            rest = matches.where(fit.members & ~off)
            found = simpler_model(rest, variance, fit.cost * rest.size / inside)
            if found is not None and found[0] == status:
                return status, f"{words} (the {m} of {n} matches that disagree may be wrong)"
    return None


def _bent_to(k: int, m: int, band: float) -> float:
    """Return the chance that a motion bends to ``k`` of ``m`` wrong matches: two, and others in its band."""
    return math.comb(m, 2) * float(bdtrc(k - 3, m - 2, band)) if k > 2 else 1.0


def _in_band(apart: FloatArray, gate: float) -> float:
    """Return the mean chance of matches ``apart`` [px] from a model to be in a band, at random directions."""
    return 2.0 / math.pi * float(np.mean(np.arcsin(gate / apart))) if len(apart) else 1.0


def _rival(fit: TwoViewFit, members: Matches, variance: float) -> tuple[Status, str] | None:
    """Return "ambiguous" where a second motion, far from the first, is nearly as likely."""
    n, best = members.size, fit.minima[0]
    freedom = n - MOTION_PARAMETERS
    floor = LEAST_NOISE_PX**2 * freedom
    least = VERY_UNLIKELY if n > FEW_POINTS else UNLIKELY if n >= MANY else NEARLY_AS_LIKELY
    for rival in fit.minima[1:]:
        if members.noise_px > 0.0:
            odds = math.exp(0.5 * (best.cost - rival.cost) / variance)
        else:
            odds = math.pow(max(best.cost, floor) / max(rival.cost, floor), 0.5 * freedom)
        turn, swing = separation(best, rival)
        if odds <= (NEARLY_AS_LIKELY if swing < BEYOND_ELLIPSOID else least):
            continue
        if turn > FAR_ROTATION or swing > FAR_DIRECTION:
            return "ambiguous", (
                f"{two_motions_apart(best, rival)} fit with rms"
                f" {_rms(best.cost, n):.3f} and {_rms(rival.cost, n):.3f} px: more points or sharper pixels"
                " are needed"
            )
    return None


def _other_members(fit: TwoViewFit) -> tuple[Status, str] | None:
    """Return "ambiguous" where leaving out other matches explains them nearly as well by another motion."""
    if fit.instead is None or not fit.instead.minima:
        return None
    if is_one_answer(fit.minima[0], fit.instead.minima[0]):
        return None
    one, other = (", ".join(map(str, np.flatnonzero(~f.members))) for f in (fit, fit.instead))
    first = f"without the matches {one} or without {other}" if one else f"with all matches or without {other}"
    return "ambiguous", (
        f"{first}, nearly as likely: {two_motions_apart(fit.minima[0], fit.instead.minima[0])}"
    )


def _rms(cost: float, n: int) -> float:
    return math.sqrt(cost / (2 * n))


def is_one_answer(one: Minimum, other: Minimum) -> bool:
    """Tell whether two minima of different members are so near each other that it does not matter which."""
    turn, swing = separation(one, other)
    return turn <= OTHER_ROTATION and swing <= OTHER_DIRECTION


def two_motions_apart(one: Minimum, other: Minimum) -> str:
    """Return in words that there are two motions, and how far they are apart."""
    turn, swing = (math.degrees(angle) for angle in separation(one, other))
    return f"two motions {turn:.1f}° (rotation) and {swing:.1f}° (direction) apart"


def separation(one: Minimum, other: Minimum) -> tuple[float, float]:
    """Return the angles between two minima's rotations and directions [rad]."""
    chord = float(np.linalg.norm(one.rotation - other.rotation))
    turn = 2.0 * math.asin(min(1.0, chord / math.sqrt(8.0)))
    swing = math.acos(max(-1.0, min(1.0, float(one.translation @ other.translation))))
    return turn, swing
