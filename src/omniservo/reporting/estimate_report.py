"""The HTML report of an estimate from two images: one file that needs nothing else."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from omniservo.estimation import TwoViewEstimate
from omniservo.files import write_whole
from omniservo.reporting.estimate_figures import estimate_drawings
from omniservo.reporting.estimate_table import estimate_table
from omniservo.reporting.framed_figure import framed
from omniservo.reporting.html import banner, judged, page, part, tag, tiles
from omniservo.reporting.residual_agreement import agreement_in_words
from omniservo.reporting.spelling import spell
from omniservo.results.run_result import Seen


def write_estimate_report(
    seen: Seen, estimate: TwoViewEstimate, path: str | Path, *, force: bool = False
) -> None:
    """Write the report; it holds its figures.

    Raises:
        InputError: the file exists and ``force`` is False, or it cannot be written.
    """
    write_whole(path, estimate_html(seen, estimate), force=force)


def estimate_html(seen: Seen, estimate: TwoViewEstimate) -> str:
    """Return the report's text."""
    good = estimate.status == "ok"
    height, width = seen.initial_image.shape
    body = [
        banner(
            "Motion and structure from two images",
            f"{len(seen.matched)} matched points, {width} × {height} px",
        ),
        judged(
            good,
            tag("strong", "Estimated" if good else f"No pose: {estimate.status.replace('_', ' ')}"),
            *(tag("p", sentence) for sentence in _sentences(seen, estimate)),
        ),
        *([tiles(_numbers(estimate))] if good else []),
        part("Result", estimate_table(estimate)),
        part(
            "Figures",
            tag("div", *(framed(d, "wide") for d in estimate_drawings(seen, estimate)), class_="figures"),
        ),
    ]
    return page("two-view estimate", body)


def _sentences(seen: Seen, estimate: TwoViewEstimate) -> list[str]:
    """Return what was found, or why nothing was."""
    if estimate.initial_T_goal is None:
        return [estimate.message]
    turn = spell(float(estimate.initial_T_goal.rotation.magnitude()), "rad")
    far = float(np.linalg.norm(estimate.initial_T_goal.translation))
    moved = f"moved {spell(far, 'm')} and" if estimate.is_metric else "moved, by a length not known, and"
    used = int(estimate.inliers.sum())
    found = f"The camera {moved} turned {turn}; {used} of {len(seen.matched)} matched points agree with that."
    told = what_is_left(seen, estimate)
    return [sentence for sentence in (found, estimate.message, told) if sentence]


def what_is_left(seen: Seen, estimate: TwoViewEstimate) -> str:
    """Return whether the residuals of either image are noise, or a pattern."""
    used = estimate.inliers
    left = estimate.residuals_px[used]
    parts = ((seen.matched.initial[used], left[:, :2]), (seen.matched.goal[used], left[:, 2:]))
    return agreement_in_words(parts, "check the camera's calibration, or the blur of what moved")


def _numbers(estimate: TwoViewEstimate) -> list[tuple[str, str, str]]:
    sigma = np.sqrt(np.maximum(np.diag(estimate.covariance), 0.0))
    length = float(np.linalg.norm(sigma[:3]))
    known = spell(length, "m") if estimate.is_metric else f"{100 * length:.2g}% of its length"
    rejected = int((~estimate.inliers).sum())
    return [
        (
            "Left in the images",
            spell(estimate.rms_px, "px"),
            f"rms; σ of a coordinate {spell(estimate.noise_px, 'px')}",
        ),
        ("Translation known to", known, "1σ, all axes together"),
        ("Rotation known to", spell(float(np.linalg.norm(sigma[3:])), "rad"), "1σ, all axes together"),
        ("Points used", str(int(estimate.inliers.sum())), f"{rejected} rejected"),
    ]
