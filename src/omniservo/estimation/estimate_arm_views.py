"""Motion and structure from views of a camera that an arm has moved, whose displacements are known."""

from __future__ import annotations

import math
import time
from dataclasses import replace

import numpy as np

from omniservo.estimation.arm_views import GOAL, ArmViews, ArmViewsOptimum, freedom_of, no_errors, weights_of
from omniservo.estimation.refinement.arm_views_system import least_of, residuals_of
from omniservo.estimation.two_view_estimate import TwoViewEstimate
from omniservo.estimation.uncertainty.arm_views_law import law_of
from omniservo.estimation.uncertainty.joint_uncertainty import JointUncertainty
from omniservo.geometry.arrays import BoolArray, IntArray, owned

GATE = 4.0
"""[σ] A pixel farther from the optimum is left out."""

LEAST_POINTS = 5

_ROUNDS = 4

_RAISED = 3.1
"""[σ] by which residuals may exceed what is stated before that is raised"""

_UNDETERMINED = "the views do not determine motion and structure"

_TOO_FEW = "too few pixels of all views agree with each other"


def estimate_arm_views(
    views: ArmViews, start: TwoViewEstimate, *, robust: bool = True
) -> tuple[TwoViewEstimate, ArmViewsOptimum | None]:
    """Return what all views say of goal and points, in the first view's frame, and the optimum.

    Args:
        views: of the n matches of the first two views.
        start: what those two say, of status "ok"; only its inliers are taken.
        robust: leave out pixels that do not agree; a point that one of the first two views loses goes.
    """
    started = time.perf_counter()
    rows, n = np.flatnonzero(start.inliers), len(start.inliers)
    length = views.known.length
    if start.initial_T_goal is None or (
        length is not None and length.rows is not None and not np.isin(length.rows, rows).all()
    ):
        return TwoViewEstimate.without_pose(n, start.status, start.message, started), None
    some = views.where(rows)
    poses = [start.initial_T_goal if pose is None else pose for pose in some.reached]
    poses[GOAL] = start.initial_T_goal
    at = ArmViewsOptimum(some, tuple(poses), start.points[rows], *no_errors(some.known))
    agree = some.seen.copy()
    for number in range(_ROUNDS if robust else 1):
        found = _least_of_agreeing(at, agree, tolerant=robust and not number)
        if isinstance(found, str):
            return TwoViewEstimate.without_pose(n, "not_converged", found, started), None
        at = found
        scale = _noise_factor(at, tolerant=not number) if some.is_guess else 1.0
        far = np.linalg.norm(residuals_of(at), axis=2) / (scale * weights_of(some))
        kept = some.seen & (far <= GATE)
        kept &= kept[0] & kept[GOAL]
        if not robust or ((kept == agree).all() and number):
            break
        agree = kept
    return _concluded(at, rows, start, started)


def estimate_at(at: ArmViewsOptimum) -> TwoViewEstimate | None:
    """Return what an optimum says as an estimate of its points alone; None: it does not determine them."""
    law, n = law_of(at), len(at.points)
    if law is None or n < LEAST_POINTS:
        return None
    everything = TwoViewEstimate.without_pose(n, "not_converged", "", 0.0)
    return _estimate_of(at, law, np.arange(n), everything, "", time.perf_counter())


def _kept_points(seen: BoolArray) -> IntArray:
    return np.flatnonzero(seen[0] & seen[GOAL])


def _least_of_agreeing(at: ArmViewsOptimum, agree: BoolArray, *, tolerant: bool) -> ArmViewsOptimum | str:
    """Return where the sum of the pixels that agree is least, or why there is none.

    A point that the first two views do not both keep has no part in it, and stays where it is.
    """
    views, good, length = replace(at.views, seen=agree), _kept_points(agree), at.views.known.length
    if len(good) < LEAST_POINTS or (
        length is not None and length.rows is not None and not np.isin(length.rows, good).all()
    ):
        return _TOO_FEW
    found = least_of(replace(at, views=views.where(good), points=at.points[good]), tolerant=tolerant)
    if found is None:
        return _UNDETERMINED
    points = at.points.copy()
    points[good] = found.points
    return replace(found, views=views, points=points)


def _concluded(
    at: ArmViewsOptimum, rows: IntArray, start: TwoViewEstimate, started: float
) -> tuple[TwoViewEstimate, ArmViewsOptimum | None]:
    n, good = len(start.inliers), _kept_points(at.views.seen)
    factor, freedom, words = _noise_factor(at), freedom_of(at), ""
    if not at.views.is_guess:
        raised = factor > 1.0 + _RAISED / math.sqrt(2.0 * max(freedom, 1.0))
        words = f"the pixels err {factor:.2g} times as much as stated" if raised else ""
        factor = factor if raised else 1.0
    views = replace(at.views, noise=factor * at.views.noise).where(good)
    at = replace(
        at, views=views, points=at.points[good],
        freedom=max(freedom, 3.0) if at.views.is_guess else math.inf,
    )  # fmt: skip
    law = law_of(at)
    if law is None:
        words = _UNDETERMINED
        return TwoViewEstimate.without_pose(n, "not_converged", words, started), None
    return _estimate_of(at, law, rows[good], start, words, started), at


def _estimate_of(
    at: ArmViewsOptimum,
    law: JointUncertainty,
    rows: IntArray,
    start: TwoViewEstimate,
    words: str,
    started: float,
) -> TwoViewEstimate:
    n = len(start.inliers)
    covariance, each = law.covariances()
    points, own = np.full((n, 3), math.nan), np.full((n, 3, 3), math.nan)
    points[rows], own[rows] = at.points, each
    residuals = np.full((n, 4), math.nan)
    gaps = residuals_of(at)
    residuals[rows] = np.concatenate((gaps[0], gaps[GOAL]), axis=1)
    inliers = np.zeros(n, dtype=np.bool_)
    inliers[rows] = True
    seen = gaps[at.views.seen]
    return TwoViewEstimate(
        status="ok",
        message=words,
        initial_T_goal=at.poses[GOAL],
        points=owned(points),
        is_metric=True,
        covariance=owned(covariance),
        points_covariance=owned(own),
        inliers=inliers,
        rms_px=float(np.sqrt(np.square(seen).sum() / len(seen))),
        noise_px=float(np.median(at.views.noise[at.views.seen])),
        residuals_px=residuals,
        seconds=time.perf_counter() - started,
        uncertainty=law,
    )


def _noise_factor(at: ArmViewsOptimum, *, tolerant: bool = False) -> float:
    """Return by which the noise is larger than it was taken to be, as the residuals tell.

    ``tolerant``: by their median, which wrong pixels hardly move.
    """
    squares = np.square(np.linalg.norm(residuals_of(at), axis=2) / weights_of(at.views))[at.views.seen]
    whole = len(squares) * float(np.median(squares)) / math.log(2.0) if tolerant else float(squares.sum())
    return math.sqrt(max(whole / max(freedom_of(at), 1.0), 1e-12))
