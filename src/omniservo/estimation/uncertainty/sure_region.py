"""What the law of a motion must hold to be sure: the region of 5 σ, and what a part of the matches would say.

An ellipsoid that is stretched to the tips of the 95% region may leave out those of the region of 5 σ, where a
valley bends only beyond. So the tips of that one are walked to as well. The region S ≤ S₀ + q₅ σ² is that of
95% for noise k = q₅/q₉₅ times as large (in variance), and so is what its tips are to be within.

Where residuals speak against one motion, though not enough to refuse it, either part of the matches may be
the one that moved: the law then holds the motions that the rest alone leaves, to 5 σ, tip by tip.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from scipy.spatial.transform import Rotation
from scipy.special import chdtri, fdtri

from omniservo.estimation.matches import Matches
from omniservo.estimation.refinement.epipolar_refinement import essential_matrix, sampson_cost
from omniservo.estimation.refinement.motion_search import Minimum
from omniservo.estimation.robust.two_view_fit import EIGHT_POINTS, TwoViewFit
from omniservo.estimation.uncertainty.first_order import determines_motion, linear_response
from omniservo.estimation.uncertainty.likelihood_region import LEVEL, Stretches, motion_offsets, stretches
from omniservo.geometry.arrays import FloatArray

BEYOND = math.erfc(5.0 / math.sqrt(2.0))
"""probability of an error beyond 5 σ"""

MANY = 2 * EIGHT_POINTS
"""Of fewer members F has tails so long that a region of 5 σ says nothing."""


class Others(NamedTuple):
    """Motions beside the best one."""

    rivals: list[Minimum]
    """other minima of the same cost"""
    doubts: list[Doubt]
    """what a part of the matches says alone, which all together may have bent from"""

    @classmethod
    def of(cls, matches: Matches, fit: TwoViewFit, parts: Sequence[TwoViewFit]) -> Others:
        """Return what a fit leaves: its other minima, and the fits to parts of the matches."""
        return cls(fit.minima[1:], [Doubt.of(matches, part) for part in parts])


class Doubt(NamedTuple):
    """The motion of a part of the matches."""

    minimum: Minimum
    unscaled: FloatArray
    """(6, 6) covariance of its (t, δ), ‖t‖ = 1, for noise of 1 px over the weight"""

    @classmethod
    def of(cls, matches: Matches, fit: TwoViewFit) -> Doubt:
        """Return the doubt that a fit to a part of the matches raises."""
        return cls.at(matches.where(fit.members), fit.minima[0])

    @classmethod
    def at(cls, members: Matches, best: Minimum) -> Doubt:
        """Return the doubt that a minimum of all the ``members`` raises."""
        each = np.tile(np.eye(2).ravel(), (members.size, 2))
        response = linear_response(
            members.parameters, members.pixels, members.weights, each,
            best.rotation, best.translation, best.points, None,
        )  # fmt: skip
        return cls(best, response.unscaled)

    def tips(self, square: float) -> list[Minimum]:
        """Return its motion, and those ``square`` (σ²) of a unit's noise away along the axes of its law."""
        values, axes = np.linalg.eigh(self.unscaled)
        best, found = self.minimum, [self.minimum]
        for way in (axes * np.sqrt(np.maximum(square * values, 0.0)))[:, 1:].T:  # ‖t‖ is held: one is zero
            for step in (way, -way):
                towards = best.translation + step[:3]
                found.append(
                    Minimum(
                        best.cost,
                        best.rotation @ Rotation.from_rotvec(step[3:]).as_matrix(),
                        towards / np.linalg.norm(towards),
                        best.points,
                        best.converged,
                    )
                )
        return found


def sure_stretches(
    matches: Matches,
    optimum: tuple[FloatArray, FloatArray],
    others: Others,
    unscaled: FloatArray,
    variance: float,
    freedom: float,
) -> Stretches:
    """Return `stretches`, and what the law must be stretched to besides to hold what is left at 5 σ."""
    usual, sure = (_quantile(chance, freedom) for chance in (1.0 - LEVEL, BEYOND))
    rivals = _with_tips(matches, optimum, others.rivals, usual * variance)
    first = stretches(matches, optimum, rivals, unscaled, variance, freedom)
    if matches.size < MANY:
        return first
    offsets = motion_offsets(*optimum, first.rotations, first.translations)
    wide = unscaled + (offsets.T * (first.weights / variance)) @ offsets
    tips = [tip for doubt in others.doubts for tip in doubt.tips(sure * variance)]
    tips += _with_tips(matches, optimum, others.rivals, sure * variance)
    far = stretches(matches, optimum, tips, wide, sure / usual * variance, freedom)
    return Stretches(
        np.concatenate((first.weights, usual / sure * far.weights)),
        np.concatenate((first.rotations, far.rotations)),
        np.concatenate((first.translations, far.translations)),
    )


def _with_tips(
    matches: Matches, optimum: tuple[FloatArray, FloatArray], rivals: list[Minimum], room: float
) -> list[Minimum]:
    """Return the rivals, and the ends of what is left of ``room`` [px²] along the axes of each one's own law.

    The truth may be at the border of the region of a rival, which has other axes than that of the optimum.
    """
    essential, found = np.empty((3, 3)), list(rivals)
    essential_matrix(*optimum, essential)
    most = sampson_cost(matches.bearings, matches.jacobians, math.inf, essential) + room
    for rival in rivals:
        is_regular = determines_motion(
            matches.parameters, matches.pixels, matches.weights,
            rival.rotation, rival.translation, rival.points,
        )  # fmt: skip
        if rival.cost < most and is_regular:
            found += Doubt.at(matches, rival).tips(most - rival.cost)[1:]
    return found


def _quantile(chance: float, freedom: float) -> float:
    """Return what the square of five numbers exceeds by this chance [σ²]."""
    return float(chdtri(5, chance) if math.isinf(freedom) else 5.0 * fdtri(5, freedom, 1.0 - chance))
