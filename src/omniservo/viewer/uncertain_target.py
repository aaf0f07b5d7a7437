"""What is not exact of a situation's target and goal: the estimate that they come from."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from omniservo.estimation import TwoViewEstimate
from omniservo.geometry.arrays import IntArray
from omniservo.planning import PlanningProblem

_SAME = 1e-9
"""[m] between an estimated point and one of the problem that are the same"""


@dataclass(frozen=True, eq=False)
class UncertainTarget:
    """An estimate, and which of its points are the problem's."""

    estimate: TwoViewEstimate
    """metric, of status "ok", with its uncertainty"""
    rows: IntArray
    """(m,) of the estimated points"""


def uncertain_target(estimate: TwoViewEstimate, problem: PlanningProblem) -> UncertainTarget | None:
    """Return an estimate as a problem's own; None: it is not, or says nothing of lengths or of its error."""
    goal = estimate.initial_T_goal
    known = estimate.status == "ok" and estimate.is_metric and estimate.uncertainty is not None
    if not known or goal is None:
        return None
    if np.abs(goal.as_matrix() - problem.initial_T_goal.as_matrix()).max() > _SAME:
        return None
    inliers = np.flatnonzero(estimate.inliers)
    apart = np.linalg.norm(problem.points[:, None] - estimate.points[None, inliers], axis=2)
    if not len(inliers) or apart.min(axis=1).max() > _SAME:
        return None
    return UncertainTarget(estimate, inliers[apart.argmin(axis=1)])
