"""Motions that explain the members of a fit as well as its own, looked for before the fit is an answer.

The cost has more than one minimum where the motion rests on little relief or little parallax, or where the
points lie on a few lines or near another critical surface, however many they are. Starts in the span of two
eigenvectors miss some; the five-point solutions of samples of the members lead to nearly all.
"""

from __future__ import annotations

import math

import numpy as np

from omniservo.estimation.matches import Matches
from omniservo.estimation.minimal_solvers.five_points import MOST_SOLUTIONS, SAMPLE, five_point_essentials
from omniservo.estimation.refinement.epipolar_refinement import essential_matrix, sampson_cost
from omniservo.estimation.refinement.motion_search import (
    START_ANGLES,
    Minimum,
    eight_point_starts,
    search_motion,
)
from omniservo.estimation.robust.consensus import draw
from omniservo.estimation.robust.members import GATE, mark_members
from omniservo.estimation.robust.two_view_fit import EIGHT_POINTS, TwoViewFit
from omniservo.geometry.arrays import FloatArray
from omniservo.geometry.kernel import kernel

SAMPLES = 20
MOST_STARTS = 20
ALIKE = 0.3
"""Of two essential matrices of norm √2 that differ by less than this, up to the sign, one is a start."""

MOST_MATCHES = 50
"""Minima of so many of the matches are near those of all."""

NO_BETTER = 0.999
"""A minimum of this part of a known one's cost, or of more, is that one."""


def with_rivals(matches: Matches, fit: TwoViewFit, kind: int, robust: bool) -> TwoViewFit:
    """Return the fit with all minima that its members leave; robust: to the members of the best of them."""
    chosen = matches.where(fit.members)
    if chosen.size < EIGHT_POINTS or not fit.minima:
        return fit
    starts = np.concatenate((_known_starts(fit.minima), _rival_starts(chosen, kind)))
    found = TwoViewFit(fit.members, search_motion(chosen, kind, starts), fit.instead)
    if not found.minima:
        return fit
    if robust:
        best, members = found.minima[0], fit.members.copy()
        count, _ = mark_members(matches, best.rotation, best.translation, GATE, members)
        if count >= EIGHT_POINTS and not np.array_equal(members, fit.members):
            starts = np.concatenate((_known_starts(found.minima), starts))
            found = TwoViewFit(members, search_motion(matches.where(members), kind, starts), fit.instead)
            return found if found.minima else fit
    is_new = len(found.minima) > len(fit.minima) or found.cost < NO_BETTER * fit.cost
    return found if is_new else fit


def _rival_starts(chosen: Matches, kind: int) -> FloatArray:
    """Return the essential matrices (s, 3, 3) of samples, or of the minima that part of many matches has."""
    few = chosen.where(np.arange(chosen.size) % math.ceil(chosen.size / MOST_MATCHES) == 0)
    spread = eight_point_starts(few.bearings, START_ANGLES)
    starts = np.concatenate((spread, sampled_starts(few.bearings, few.jacobians)))
    return starts if few.size == chosen.size else _known_starts(search_motion(few, kind, starts))


def _known_starts(minima: list[Minimum]) -> FloatArray:
    """Return the essential matrices (s, 3, 3) of minima."""
    starts = np.empty((len(minima), 3, 3))
    for minimum, essential in zip(minima, starts, strict=True):
        essential_matrix(minimum.rotation, minimum.translation, essential)
    return starts


@kernel
def sampled_starts(bearings: FloatArray, jacobians: FloatArray) -> FloatArray:
    """Return E (s, 3, 3) of samples of five matches, those of least Σd² that are not alike, best first."""
    found, chosen = np.empty((SAMPLES * MOST_SOLUTIONS, 3, 3)), np.empty(SAMPLE, dtype=np.int64)
    count, state = 0, 1
    for _ in range(SAMPLES):
        state = draw(state, bearings.shape[0], chosen)
        count += five_point_essentials(bearings, chosen, found[count:])
    costs = np.empty(count)
    for k in range(count):
        costs[k] = sampson_cost(bearings, jacobians, math.inf, found[k])
    starts, kept = np.empty((MOST_STARTS, 3, 3)), 0
    for k in np.argsort(costs):
        other = 0
        while other < kept and abs((starts[other] * found[k]).sum()) < 2.0 - 0.5 * ALIKE**2:
            other += 1
        if other == kept and kept < MOST_STARTS:
            starts[kept] = found[k]
            kept += 1
    return starts[:kept]
