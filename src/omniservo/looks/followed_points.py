"""Which of the estimated points are planned for and servoed on."""

from __future__ import annotations

import numpy as np

from omniservo.estimation import TwoViewEstimate
from omniservo.geometry.arrays import BoolArray, FloatArray, IntArray
from omniservo.planning import PlanningProblem

MOST_POINTS = 40
"""More add little to the control and all must stay in view."""

WELL_KNOWN = 0.7
"""Where there are more, this share of them is considered: those whose position is known best."""


ENOUGH = 12
"""So many points that both ends of a path show with its margin will do: no path shows the others."""


def followed_points(
    estimate: TwoViewEstimate, pixels: FloatArray, shown: BoolArray | None = None
) -> IntArray:
    """Return the rows (m,) of the points to follow, ascending: inliers, well known, spread over the image.

    Up to `MOST_POINTS` all inliers; of more, one after the other the point farthest in the image from
    those chosen so far.

    Args:
        estimate: with status "ok".
        pixels: (n, 2) [px] of its points in the initial image.
        shown: (n,) which of them both ends of a path show (`shown_at_ends`): where these are `ENOUGH`, the
            others are not followed. None: all.
    """
    members = np.flatnonzero(estimate.inliers)
    if shown is not None and np.count_nonzero(shown[members]) >= ENOUGH:
        members = members[shown[members]]
    return spread_rows(estimate, pixels, members, MOST_POINTS)


def spread_rows(estimate: TwoViewEstimate, pixels: FloatArray, members: IntArray, most: int) -> IntArray:
    """Return at most so many of the rows ``members``, ascending: well known, and spread over the image.

    Args:
        estimate: of the points.
        pixels: (n, 2) where the image shows them [px]; NaN: not at all, which come last.
        members: (k,) rows to choose from.
        most: so many are chosen; where there are no more, they are all.
    """
    if len(members) <= most:
        return members
    spread = np.trace(estimate.points_covariance[members], axis1=1, axis2=2)
    distance = np.linalg.norm(estimate.points[members], axis=1)
    hidden = ~np.isfinite(pixels[members]).all(axis=1)
    order = np.lexsort((spread / distance**2, hidden))
    members = members[order[: max(most, int(WELL_KNOWN * len(members)))]]
    places = pixels[members]
    gaps, chosen, last = np.full(len(members), np.inf), [0], 0
    while len(chosen) < most:
        apart = np.linalg.norm(places - places[last], axis=1)
        gaps = np.minimum(gaps, np.nan_to_num(apart, nan=0.0))
        gaps[last] = -1.0  # none is chosen twice
        last = int(np.argmax(gaps))
        chosen.append(last)
    return np.sort(members[chosen])


def shown_at_ends(problem: PlanningProblem, estimate: TwoViewEstimate) -> BoolArray:
    """Return which points (n,) lie inside the image's cones, with a problem's whole margin, at both ends."""
    pose, points = estimate.initial_T_goal, estimate.points
    if pose is None:
        return np.zeros(len(points), dtype=np.bool_)
    limits = problem.camera.image_limits(problem.image_margin)
    shown = np.ones(len(points), dtype=np.bool_)
    for seen in (points, pose.inv().apply(points)):
        reach = np.linalg.norm(seen, axis=1)[:, None] * limits.kappas
        shown &= (seen @ limits.normals.T <= reach).all(axis=1)  # False for NaN
    return shown
