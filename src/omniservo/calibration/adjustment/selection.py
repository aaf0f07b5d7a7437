"""Which views and corners belong to one camera, and why the others do not."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from omniservo.calibration.adjustment.poses import linear_fit_px, poses_from_corners
from omniservo.calibration.adjustment.refine import State, refine, residuals
from omniservo.calibration.adjustment.starts import robust_fit
from omniservo.calibration.adjustment.views import Views, flatness
from omniservo.geometry.arrays import BoolArray, FloatArray

WRONG_VIEW = 4.0
"""a view is wrong when its median error is this many times the typical view's"""

WRONG_CORNER = 8.0
"""a corner is wrong when it is this many standard deviations (of one coordinate) off"""

_MOST_WRONG = 0.25
"""a view with more wrong corners than this part is wrong as a whole"""

_LEAST_NOISE_PX = 0.02
"""no image is sharper: corners closer than that differ by rounding, not by mistakes"""

_RAYLEIGH = 1.1774
"""median of ‖e‖ over the standard deviation of one coordinate, for normal errors"""

_ROUNDS = 6


@dataclass(frozen=True, eq=False)
class Selection:
    """What is used: the views, their corners, the camera that they gave."""

    views: Views
    """only those that are used"""
    state: State
    keep: BoolArray
    """(N,) corners of those views that are used"""
    dropped: dict[int, str]
    """number of a view → why it is not used"""
    dropped_corners: dict[int, dict[int, str]]
    """number of a view that is used → row → why that corner is not"""


def select(views: Views, theta: FloatArray, typical_px: float, free: BoolArray) -> Selection:
    """Return the views and corners that one camera explains, starting from the camera θ.

    In turn: adjust robustly; call a view or a corner wrong that is too far off; adjust to the others;
    judge all again,
    with poses found anew, until nothing changes. A corner or view that was called wrong can come back.
    """
    scale = 3.0 * max(typical_px, _LEAST_NOISE_PX)
    state = poses_from_corners(views, theta, scale)
    state, _ = robust_fit(views, state, free, rounds=2)
    state = poses_from_corners(views, state.theta, scale)
    good, keep, typical = _judge(views, state)
    for _ in range(_ROUNDS):
        if not good.any():
            break
        state = _refit(views, state, good, keep, free, 3.0 * typical)
        before = good, keep
        good, keep, typical = _judge(views, state)
        if (good == before[0]).all() and (keep == before[1]).all():
            break
    return _selection(views, state, good, keep, typical)


def _refit(
    views: Views, state: State, good: BoolArray, keep: BoolArray, free: BoolArray, scale_px: float
) -> State:
    """Return the least-squares camera of the good views, with new robust poses of the others under it."""
    chosen = np.flatnonzero(good)
    part = views.some(chosen)
    moved, _, _ = refine(part, state.some(chosen), free, keep=keep[views.rows_of(chosen)])
    rotations, translations = np.array(state.rotations), np.array(state.translations)
    rotations[chosen], translations[chosen] = moved.rotations, moved.translations
    others = np.flatnonzero(~good)
    if len(others):
        posed = poses_from_corners(views.some(others), moved.theta, scale_px)
        rotations[others], translations[others] = posed.rotations, posed.translations
    return State(moved.theta, rotations, translations)


def _judge(views: Views, state: State) -> tuple[BoolArray, BoolArray, float]:
    """Return which views (V,) and which corners (N,) are right, and the typical view's median error [px]."""
    errors = _lengths(residuals(views, state))
    medians = views.median(errors)
    typical = max(float(np.median(medians)), _RAYLEIGH * _LEAST_NOISE_PX)
    good = medians <= WRONG_VIEW * typical
    keep = errors <= WRONG_CORNER / _RAYLEIGH * np.maximum(medians, typical)[views.row_view]
    for i in (int(i) for i in np.flatnonzero(good)):
        rows = views.rows(i)
        good[i] = keep[rows].mean() >= 1.0 - _MOST_WRONG and _spans(views.points[rows][keep[rows]])
    return good, keep & good[views.row_view], typical


def _spans(points: FloatArray) -> bool:
    """Return whether target points determine a pose: four not on a line, or six not on a plane."""
    if len(points) < 4:
        return False
    extents = np.linalg.svd(points - points.mean(0), compute_uv=False)
    return bool(extents[1] > 0.02 * extents[0]) and (len(points) >= 6 or flatness(points)[2])


def _selection(views: Views, state: State, good: BoolArray, keep: BoolArray, typical: float) -> Selection:
    errors = _lengths(residuals(views, state))
    wrong = np.flatnonzero(~good)
    reasons = _reasons(views.some(wrong), state.theta, errors[views.rows_of(wrong)], typical)
    corners: dict[int, dict[int, str]] = {}
    for i in (int(i) for i in np.flatnonzero(good)):
        rows = views.rows(i)
        off = {
            int(j): f"{errors[rows][j]:.3g} px off; {typical:.2g} px is typical"
            for j in np.flatnonzero(~keep[rows])
        }
        if off:
            corners[int(views.numbers[i])] = off
    chosen = np.flatnonzero(good)
    return Selection(views.some(chosen), state.some(chosen), keep[views.rows_of(chosen)], reasons, corners)


def _reasons(views: Views, theta: FloatArray, errors: FloatArray, typical: float) -> dict[int, str]:
    """Say of each wrong view (all views here) what is wrong with it, as far as its corners tell."""
    if not views.count:
        return {}
    linear = linear_fit_px(views, theta, np.ones(len(errors), dtype=np.bool_))
    reasons = {}
    for i in range(views.count):
        part = errors[views.rows(i)]
        median = float(np.median(part))
        off = int((part > WRONG_CORNER / _RAYLEIGH * typical).sum())
        fit = f"with the other views' camera its median error is {median:.3g} px, theirs {typical:.2g} px"
        if median <= WRONG_VIEW * typical:
            worst = f"up to {part.max():.3g} px ({typical:.2g} px is typical)"
            text = f"{off} of {len(part)} corners are too far off, {worst}"
        elif linear[i] > WRONG_VIEW * typical:
            plane = f"no stretched target fits either ({linear[i]:.3g} px)"
            text = f"{fit}, and {plane}: corners out of order, or not of this target"
        else:
            text = (
                f"{fit}, though a stretched target would fit ({linear[i]:.2g} px): the target's measures are "
                "wrong, or the image comes from another camera, zoom or size"
            )
        reasons[int(views.numbers[i])] = text
    return reasons


def _lengths(errors: FloatArray) -> FloatArray:
    return np.asarray(np.hypot(errors[:, 0], errors[:, 1]))
