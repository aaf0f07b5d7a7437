"""What stands in a run's folder, file by file."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

from omniservo.reporting.html import Cell, Markup, joined, table, tag

_MEANINGS = {
    "metrics.json": "every number of this page, for programs",
    "log.csv": "every control step: times, joints, pixels, twists, distances",
    "plan.json": "the plan with its problem and certificate: omniservo verify plan.json",
    "estimate.json": "motion and structure from the initial and the goal image",
    "goal.json": "the goal as taught: omniservo run … --goal goal.json",
    "initial.png": "the image at the start",
    "goal.png": "the goal image",
    "final.png": "the image at the end",
    "recording.gif": "the animation above",
}


def files_beside(folder: Path, figures: Mapping[str, str]) -> Markup | None:
    """Return a table of the folder's files but the report; None where there is none.

    Args:
        folder: as it stands, unknown files included.
        figures: title of each figure by the name of its files.
    """
    names = sorted(path.name for path in folder.iterdir() if path.name != "report.html")
    drawn = [name for name in figures if {f"{name}.png", f"{name}.svg"} <= set(names)]
    of_figures = {f"{name}.{ending}" for name in drawn for ending in ("png", "svg")}
    others = [name for name in names if name not in of_figures]
    rows: list[list[Cell]] = [
        [tag("code", name), _MEANINGS.get(name, "")]
        for name in sorted(others, key=lambda name: (name not in _MEANINGS, name))
    ]
    rows += [[tag("code", f"{name}.png, {name}.svg"), f"figure: {figures[name]}"] for name in drawn]
    return joined([table(["file", "what it is"], rows)]) if rows else None
