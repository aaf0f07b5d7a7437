"""What a camera misses on views that did not help to make it."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.special import stdtr

from omniservo.calibration.adjustment.lens import ray_errors
from omniservo.calibration.adjustment.refine import State, refine, refine_poses, residuals
from omniservo.calibration.adjustment.views import Views
from omniservo.geometry.arrays import BoolArray, FloatArray

_FOLDS = 5
LEAST_VIEWS = 4
"""three are needed to make a camera, one to judge it"""

_ASKED = ((0.01, 0.01), (0.2, 0.05))
"""(part, p): distortion must lower the held-out rms by this part, so surely. Of four views no test is as
sure as of many; a large gain is accepted sooner."""


@dataclass(frozen=True, eq=False)
class HeldOut:
    """Errors on held-out views, and the cameras of the folds."""

    px: float
    """root mean square distance between corner and projection [px]"""
    deg: float
    """the same as an angle between rays [deg]"""
    views_px: FloatArray
    """(V,) by view [px]"""
    cameras: tuple[FloatArray, ...]
    """θ without each fold in turn"""
    residuals: FloatArray
    """(N, 2) projection − corner [px], each view's under the camera of the others, its pose adjusted"""


def held_out(views: Views, state: State, free: BoolArray, keep: BoolArray) -> HeldOut | None:
    """Return the errors of k-fold validation over views, None with too few views.

    View i is in fold i mod 5 (each alone with five views or fewer). The camera is adjusted to the other
    folds; of a
    held-out view only its pose (6 numbers) is adjusted, for which its mean square is scaled by 2k/(2k − 6).
    """
    if views.count < LEAST_VIEWS:
        return None
    folds = min(_FOLDS, views.count)
    fold = np.arange(views.count) % folds
    squares, angles = np.zeros(views.count), np.zeros(views.count)
    left = np.zeros_like(views.pixels)
    cameras = []
    for j in range(folds):
        inside, outside = np.flatnonzero(fold != j), np.flatnonzero(fold == j)
        made, _, _ = refine(views.some(inside), state.some(inside), free, keep=keep[views.rows_of(inside)])
        cameras.append(made.theta)
        rest, kept = views.some(outside), keep[views.rows_of(outside)]
        posed, _ = refine_poses(
            rest, state.some(outside).with_theta(made.theta), scale_px=None, keep=kept, iterations=10
        )
        errors = left[views.rows_of(outside)] = residuals(rest, posed)
        rays = ray_errors(made.theta, posed.points(rest), errors)
        for place, view in enumerate(outside):
            rows = rest.rows(place)
            used = kept[rows]
            extra = used.sum() / max(2.0 * used.sum() - 6.0, 1.0) * 2.0
            squares[view] = extra * (errors[rows][used] ** 2).sum(1).mean()
            angles[view] = extra * (rays[rows][used] ** 2).mean()
    counts = np.add.reduceat(keep.astype(np.float64), views.ends[:-1])
    return HeldOut(
        float(np.sqrt(np.average(squares, weights=counts))),
        float(np.degrees(np.sqrt(np.average(angles, weights=counts)))),
        np.sqrt(squares),
        tuple(cameras),
        left,
    )


def distortion_helps(plain: HeldOut | None, distorted: HeldOut | None) -> tuple[bool, str]:
    """Return whether held-out views support distortion, and the evidence in words.

    They do when the pooled rms falls by at least 1% and the mean over views of ln(plain error / distorted
    error) is above 0 in a one-sided t test at 1%; or by 20%, and at 5%. A ratio a view, because views differ
    in sharpness far more than models do.
    """
    if plain is None or distorted is None:
        return False, f"no distortion: too few views to test it; at least {LEAST_VIEWS} are needed"
    gain = 1.0 - distorted.px / plain.px if plain.px > 0.0 else 0.0
    if not np.isfinite(distorted.px):
        return False, "the camera with distortion does not hold on views left out"
    ratios = np.log(np.maximum(plain.views_px, 1e-12) / np.maximum(distorted.views_px, 1e-12))
    n = len(ratios)
    error = ratios.std(ddof=1) / np.sqrt(n)
    t = float(ratios.mean() / error) if error > 0.0 else 0.0
    p = float(stdtr(n - 1, -t))
    helps = any(gain >= least and p <= most for least, most in _ASKED)
    numbers = (
        f"on views left out the error is {plain.px:.4g} px without and {distorted.px:.4g} px with "
        f"distortion ({100.0 * gain:+.1f}% better); better by view with t = {t:.1f}, p = {p:.2g}"
    )
    needed = " or ".join(f"{100.0 * least:.0f}% and p ≤ {most:g}" for least, most in _ASKED) + " are needed"
    found = "the views support distortion" if helps else "the views do not support distortion"
    return helps, f"{found}: {numbers}; {needed}"
