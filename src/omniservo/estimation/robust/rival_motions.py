"""Motions that explain the members of a fit as well as its own, looked for where a plane nearly does.

Where a homography leaves little more than the motion does, the motion rests on little relief or little
parallax, and its cost has more than one minimum, however many the points: one start may miss the best.
"""

from __future__ import annotations

import numpy as np

from omniservo.estimation.matches import Matches
from omniservo.estimation.refinement.epipolar_refinement import essential_matrix
from omniservo.estimation.refinement.motion_search import (
    HOPELESS,
    LEAST_NOISE_PX,
    START_ANGLES,
    eight_point_starts,
    search_motion,
)
from omniservo.estimation.robust.members import GATE, mark_members
from omniservo.estimation.robust.two_view_fit import EIGHT_POINTS, TwoViewFit
from omniservo.estimation.status.degenerate_motion import HOMOGRAPHY, simpler_costs
from omniservo.geometry.arrays import FloatArray


def with_rivals(matches: Matches, fit: TwoViewFit, kind: int, robust: bool) -> TwoViewFit:
    """Return the fit with all minima that a plane hides; robust: to the members of the best of them."""
    chosen = matches.where(fit.members)
    if chosen.size < EIGHT_POINTS or not fit.minima:
        return fit
    most = HOPELESS * max(fit.cost, LEAST_NOISE_PX**2 * chosen.size)
    if not simpler_costs(chosen, np.full(3, most))[HOMOGRAPHY] < most:
        return fit
    starts = np.concatenate((_known_starts(fit), eight_point_starts(chosen.bearings, START_ANGLES)))
    found = TwoViewFit(fit.members, search_motion(chosen, kind, starts), fit.instead)
    if not found.minima:
        return fit
    if robust:
        best, members = found.minima[0], fit.members.copy()
        count, _ = mark_members(matches, best.rotation, best.translation, GATE, members)
        if count >= EIGHT_POINTS and not np.array_equal(members, fit.members):
            starts = np.concatenate((_known_starts(found), starts))
            found = TwoViewFit(members, search_motion(matches.where(members), kind, starts), fit.instead)
    return found if found.minima else fit


def _known_starts(fit: TwoViewFit) -> FloatArray:
    """Return the essential matrices (s, 3, 3) of the minima that are known."""
    starts = np.empty((len(fit.minima), 3, 3))
    for minimum, essential in zip(fit.minima, starts, strict=True):
        essential_matrix(minimum.rotation, minimum.translation, essential)
    return starts
