"""Motion and structure from two images as a table, with 1σ."""

from __future__ import annotations

import math

import numpy as np

from omniservo.estimation import TwoViewEstimate
from omniservo.geometry.arrays import FloatArray
from omniservo.reporting.html import Markup, table
from omniservo.reporting.spelling import spell

MOST_DIGITS = 9


def estimate_table(found: TwoViewEstimate) -> Markup:
    """Return what two images gave about motion and structure."""
    sigma = np.sqrt(np.maximum(np.diag(found.covariance), 0.0))
    rows = [["status", found.status], ["points used", f"{int(found.inliers.sum())} of {len(found.inliers)}"]]
    if found.message:
        rows.append(["because", found.message])
    if found.initial_T_goal is not None:
        length, factor = ("mm", 1e3) if found.is_metric else ("lengths of t", 1.0)
        shift = found.initial_T_goal.translation
        turn = np.rad2deg(found.initial_T_goal.rotation.as_rotvec())
        shift_sigma, turn_sigma = factor * sigma[:3], np.rad2deg(sigma[3:])
        digits, turn_digits = _digits(shift_sigma, 3), _digits(turn_sigma, 4)
        rows += [
            ["residual, rms over both images", spell(found.rms_px, "px")],
            ["σ of a pixel coordinate, from the residuals", spell(found.noise_px, "px")],
            ["metric", "yes" if found.is_metric else "no: the translation has length 1"],
            [f"goal, translation [{length}]", _vector(factor * shift, digits)],
            ["… 1σ", _vector(shift_sigma, digits)],
            ["goal, rotation vector [°]", _vector(turn, turn_digits)],
            ["… 1σ, about the goal camera's axes", _vector(turn_sigma, turn_digits)],
        ]
    return table(["motion and structure from two images", "along x, y, z of the initial camera"], rows)


def _digits(sigma: FloatArray, least: int) -> int:
    """Return how many decimals show two figures of the largest σ."""
    largest = float(sigma.max())
    return least if largest <= 0.0 else min(max(least, 1 - math.floor(math.log10(largest))), MOST_DIGITS)


def _vector(values: FloatArray, digits: int) -> str:
    return ", ".join(f"{value:.{digits}f}" for value in values).replace("-", "−")
