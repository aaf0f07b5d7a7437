"""The HTML report of an estimate from two images: one file that needs nothing else."""

from __future__ import annotations

from pathlib import Path

from omniservo.estimation import TwoViewEstimate
from omniservo.files import write_whole
from omniservo.reporting.estimate_figures import estimate_drawings
from omniservo.reporting.estimate_table import estimate_table
from omniservo.reporting.framed_figure import framed
from omniservo.reporting.html import Markup, banner, judged, page, part, tag
from omniservo.simulation.run_result import Seen


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
            tag("strong", "Estimated" if good else f"No pose: {estimate.status}"),
            tag("p", estimate.message) if estimate.message else Markup(""),
        ),
        part("Result", estimate_table(estimate)),
        part(
            "Figures",
            tag("div", *(framed(d, "wide") for d in estimate_drawings(seen, estimate)), class_="figures"),
        ),
    ]
    return page("two-view estimate", body)
