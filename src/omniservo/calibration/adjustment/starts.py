"""Where the adjustment begins: cameras all over (ξ, focal length), judged by how rigid targets become."""

from __future__ import annotations

import numpy as np

from omniservo.calibration.adjustment.lens import PLAIN, unproject_plain
from omniservo.calibration.adjustment.poses import Targets, misfit, poses_from_corners
from omniservo.calibration.adjustment.refine import State, refine, refine_poses, residuals
from omniservo.calibration.adjustment.views import Views
from omniservo.geometry.arrays import BoolArray, FloatArray, IntArray

_ALPHAS = (0.0, 0.25, 0.4, 0.5, 0.6, 0.68, 0.76)
_LENGTHS = tuple(float(x) for x in np.geomspace(0.08, 6.0, 16))
"""g as parts of the image's longer side: from a fisheye in a part of the image to a telephoto lens"""

_MOST_VIEWS = 16
"""as many views, spread over all, are enough to compare starts"""

_STARTS = 4
_ROUGH_PX = 3.0
_MOST_UNSEEN = 0.25
_WORSE = 4.0
"""a view whose corners fit this many times worse than the typical view's waits until the camera is known"""


def best_starts(views: Views, size: tuple[int, int], signs: tuple[float, ...]) -> list[FloatArray]:
    """Return the few most promising θ, each with another α, best first.

    Each camera of the grid gives bearings; the linear map of each view is brought to the nearest rigid pose.
    What the corners then miss, g times the angle, median over a view's corners and over the views, is its
    score.
    """
    some = views.some(spread(views.count))
    targets = Targets(some)
    centre = (np.array(size) - 1.0) / 2.0
    found: list[tuple[float, float, FloatArray]] = []
    for sign in signs:
        for alpha in _ALPHAS:
            scored = []
            for part in _LENGTHS:
                g = part * max(size)
                theta = np.array([g, sign * g, *centre, alpha, 0.0, 0.0, 0.0, 0.0])
                scored.append((rigid_misfit_px(targets, theta), theta))
            score, theta = min(scored, key=lambda pair: pair[0])
            if np.isfinite(score):
                found.append((score, alpha, theta))
    return [theta for _, _, theta in sorted(found, key=lambda entry: entry[0])[:_STARTS]]


def rigid_misfit_px(targets: Targets, theta: FloatArray) -> float:
    """Return the score of θ [px]; infinite where too many corners have no bearing."""
    views = targets.views
    bearings, seen = unproject_plain(theta, views.pixels)
    if 1.0 - seen.mean() > _MOST_UNSEEN:
        return np.inf
    maps = targets.maps(bearings, seen.astype(np.float64))
    rotations, translations = targets.poses(maps)
    rigid = np.zeros_like(maps)
    # the pose of the coordinates that `maps` takes: turned by the target's axes, in its size, from its centre
    rigid[:, :, :3] = rotations @ targets.axes
    centres = (rotations @ targets.centres[:, :, None])[:, :, 0] + translations
    rigid[:, :, 3] = centres / targets.sizes[:, None]
    errors = np.where(seen, misfit(targets, rigid, bearings), np.pi)
    return float(np.median(views.median(errors)) * np.abs(theta[0]))


def adjusted_start(views: Views, theta: FloatArray) -> tuple[State, float]:
    """Return the plain camera that θ leads to on some of the views, robustly, and its typical error [px]."""
    some = views.some(spread(views.count))
    return robust_fit(some, poses_from_corners(some, theta, _ROUGH_PX), PLAIN, rounds=2)


def robust_fit(views: Views, start: State, free: BoolArray, *, rounds: int) -> tuple[State, float]:
    """Return the state after some rounds of adjustment with Cauchy's loss, and its typical error [px].

    The scale of each round is taken from the typical error of the one before, the median over the views of
    the
    median over their corners. Views that fit much worse than the typical one do not move the camera.
    """
    state = start
    for _ in range(rounds):
        state, _ = _robust_round(views, state, free)
    medians = _medians(views, state)
    return state, float(np.median(medians))


def _robust_round(views: Views, state: State, free: BoolArray) -> tuple[State, float]:
    medians = _medians(views, state)
    typical = float(np.median(medians))
    good = medians <= max(_WORSE * typical, 1e-9)
    scale = max(2.0 * typical, 1e-6)
    keep = good[views.row_view]
    keep &= np.isfinite(residuals(views, state)).all(1)
    moved, _, _ = refine(
        views.some(np.flatnonzero(good)), state.some(np.flatnonzero(good)), free,
        keep=keep[good[views.row_view]], scale_px=scale, iterations=40,
    )  # fmt: skip
    rotations, translations = np.array(state.rotations), np.array(state.translations)
    rotations[good], translations[good] = moved.rotations, moved.translations
    together = State(moved.theta, rotations, translations)
    return refine_poses(views, together, scale_px=scale)[0], typical


def _medians(views: Views, state: State) -> FloatArray:
    errors = residuals(views, state)
    return views.median(np.hypot(errors[:, 0], errors[:, 1]))


def spread(count: int) -> IntArray:
    """Return at most 16 of ``count`` views, evenly spread."""
    return np.unique(np.linspace(0, count - 1, min(count, _MOST_VIEWS)).astype(np.int64))
