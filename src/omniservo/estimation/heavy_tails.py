"""Rejected matches that are not wrong ones: errors with longer tails than a normal law.

A wrong match lies anywhere; few come near the epipolar geometry of the others by chance. Where more of the
rejected lie within `TAIL` σ than that chance explains, they are points badly found, in a blurred picture
perhaps, and so may members be: then the rejected near ones count as noise.
"""

from __future__ import annotations

import numpy as np
from scipy.special import bdtrc

from omniservo.estimation.epipolar_refinement import essential_matrix, sampson_distances
from omniservo.estimation.matches import Matches
from omniservo.estimation.two_view_fit import FEW_POINTS, TwoViewFit

TAIL = 15.0
"""[σ] beyond which a match is a wrong one"""

CHANCE = 0.01


def tail_of(matches: Matches, fit: TwoViewFit, sigma: float) -> tuple[float, int]:
    """Return Σ w²d² [px²] of the rejected matches that belong to the noise, and how many they are.

    Of many matches the members alone tell the noise. ``sigma`` is that of a coordinate of weight 1 [px].
    """
    rejected = int(np.count_nonzero(~fit.members))
    if rejected == 0 or matches.size > FEW_POINTS:
        return 0.0, 0
    essential, distances = np.empty((3, 3)), np.empty(matches.size)
    essential_matrix(fit.minima[0].rotation, fit.minima[0].translation, essential)
    sampson_distances(matches.bearings, matches.jacobians, essential, distances)
    near = ~fit.members & (np.abs(distances) < TAIL * sigma)
    count = int(near.sum())
    extent = max(float(np.hypot(*np.ptp(matches.pixels[:, 2:], axis=0))), 1.0)
    band = min(2.0 * TAIL * sigma / extent, 1.0)
    if count == 0 or float(bdtrc(count - 1, rejected, band)) >= CHANCE:
        return 0.0, 0
    return float(np.square(distances[near]).sum()), count
