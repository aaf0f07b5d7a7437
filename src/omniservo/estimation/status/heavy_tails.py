"""Rejected matches that are not wrong ones: errors with longer tails than a normal law.

A wrong match lies anywhere; few come near the epipolar geometry of the others by chance. Where more of the
rejected lie within `TAIL` σ than that chance explains, they are points badly found, in a blurred image
perhaps, and so may members be: then the rejected near ones count as noise. Where they are many, some motion
fits whichever of them happen to agree.
"""

from __future__ import annotations

import numpy as np
from scipy.special import bdtrc

from omniservo.estimation.matches import Matches
from omniservo.estimation.refinement.epipolar_refinement import essential_matrix, sampson_distances
from omniservo.estimation.robust.members import GATE
from omniservo.estimation.robust.two_view_fit import TwoViewFit
from omniservo.geometry.arrays import FloatArray

TAIL = 15.0
"""[σ] beyond which a match is a wrong one"""

CHANCE = 0.01


LARGEST_TAIL = 0.2
"""of the matches; with more of them badly found, the members are those that happen to agree"""


def tail_of(matches: Matches, fit: TwoViewFit, sigma: float) -> tuple[float, int]:
    """Return Σ w²d² [px²] of the rejected matches that belong to the noise, and how many they are.

    ``sigma`` is that of a coordinate of weight 1 [px].
    """
    if fit.members.all():
        return 0.0, 0
    misses = near_misses(matches, fit, sigma)
    return float(np.square(misses).sum()), len(misses)


def badly_found(matches: Matches, fit: TwoViewFit, sigma: float) -> str | None:
    """Return the evidence that too many matches are badly found to trust those that agree."""
    least = LARGEST_TAIL * matches.size
    if np.count_nonzero(~fit.members) <= least or len(misses := near_misses(matches, fit, sigma)) <= least:
        return None
    return (
        f"{len(misses)} of the {matches.size} matches miss the motion of the others by a few times the noise:"
        " they are badly found, as in blurred pictures, or the noise stated is too small"
    )


def near_misses(matches: Matches, fit: TwoViewFit, sigma: float) -> FloatArray:
    """Return the Sampson distances [px] of rejected matches within `TAIL` σ; none that chance explains.

    Nearer than half the gate a match was rejected because its rays meet behind a camera.
    """
    rejected = int(np.count_nonzero(~fit.members))
    if rejected == 0:
        return np.empty(0)
    essential, distances = np.empty((3, 3)), np.empty(matches.size)
    essential_matrix(fit.minima[0].rotation, fit.minima[0].translation, essential)
    sampson_distances(matches.bearings, matches.jacobians, essential, distances)
    apart = np.abs(distances)
    misses = distances[~fit.members & (apart > 0.5 * GATE * sigma) & (apart < TAIL * sigma)]
    extent = max(float(np.hypot(*np.ptp(matches.pixels[:, 2:], axis=0))), 1.0)
    band = min(2.0 * TAIL * sigma / extent, 1.0)
    if len(misses) == 0 or float(bdtrc(len(misses) - 1, rejected, band)) >= CHANCE:
        return np.empty(0)
    return misses
