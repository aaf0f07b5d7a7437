"""Which of the estimated points are planned for and servoed on."""

from __future__ import annotations

import numpy as np

from omniservo.estimation import TwoViewEstimate
from omniservo.geometry.arrays import FloatArray, IntArray

MOST_POINTS = 40
"""More add little to the control and all must stay in view."""

WELL_KNOWN = 0.7
"""Where there are more, this share of them is considered: those whose position is known best."""


def followed_points(estimate: TwoViewEstimate, pixels: FloatArray) -> IntArray:
    """Return the rows (m,) of the points to follow, ascending: inliers, well known, spread over the picture.

    Up to `MOST_POINTS` all inliers; of more, one after the other the point farthest in the picture from
    those chosen so far.

    Args:
        estimate: with status "ok".
        pixels: (n, 2) [px] of its points in the initial picture.
    """
    members = np.flatnonzero(estimate.inliers)
    if len(members) <= MOST_POINTS:
        return members
    spread = np.trace(estimate.points_covariance[members], axis1=1, axis2=2)
    distance = np.linalg.norm(estimate.points[members], axis=1)
    order = np.argsort(spread / distance**2)
    members = members[order[: max(MOST_POINTS, int(WELL_KNOWN * len(members)))]]
    chosen = [int(members[0])]
    gaps = np.linalg.norm(pixels[members] - pixels[chosen[0]], axis=1)
    while len(chosen) < MOST_POINTS:
        chosen.append(int(members[np.argmax(gaps)]))
        gaps = np.minimum(gaps, np.linalg.norm(pixels[members] - pixels[chosen[-1]], axis=1))
    return np.sort(np.array(chosen))
