"""The paper's numbers beside ours, for the two tasks that repeat its experiments."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from omniservo.reporting.curves import planned_curve
from omniservo.reporting.margins import certified_clearance, certified_visibility
from omniservo.reporting.promise_words import CERTIFIED, EXECUTED, REQUIRED
from omniservo.reporting.spelling import NOTHING, significant, spell, spell_bound
from omniservo.results.run_result import RunResult


@dataclass(frozen=True)
class PaperNumbers:
    """What the 2012 paper reports of one experiment (its section 4)."""

    example: int
    smallest_distance: float
    """[mm] of the planned path to the obstacle points"""
    safe_distance: float
    """[mm]"""
    estimation_seconds: float
    planning_seconds: float
    degree: int
    """σ = τ"""


PAPER = {
    "paper-example-1": PaperNumbers(1, 66.127, 55.0, 3.073, 2.796, 2),
    "paper-example-2": PaperNumbers(2, 82.249, 70.0, 3.899, 1.814, 2),
}
"""by the name of the task that repeats the experiment"""


@dataclass(frozen=True)
class ComparisonRow:
    """One quantity: the paper's value and ours."""

    quantity: str
    paper: str
    ours: str
    unit: str


def comparison_table(result: RunResult) -> tuple[ComparisonRow, ...]:
    """Return the paper's numbers beside the run's; no rows where the task is not one of the paper's.

    The words are those of `promise_words`; "sampled" is on 401 samples of the planned path. The paper gives
    one number.
    """
    paper = PAPER.get(result.task.name)
    if paper is None:
        return ()
    planning, metrics = result.task.planning, result.metrics
    asked = f"{1e3 * planning.clearance:g}"
    if planning.tracking_margin > 0.0 and result.plan is not None:
        asked += f" + {1e3 * planning.tracking_margin:g} for tracking"
    degrees = planning.degrees
    return (
        ComparisonRow(f"safe distance, {REQUIRED}", f"{paper.safe_distance:g}", asked, "mm"),
        ComparisonRow(
            "smallest distance to the obstacle points, planned path (sampled)",
            f"{paper.smallest_distance:.3f}",
            _bare(_smallest_planned(result), 1e3),
            "mm",
        ),
        ComparisonRow(f"… {CERTIFIED}", NOTHING, _bound(certified_clearance(result), "m"), "mm"),
        ComparisonRow(f"… {EXECUTED}", NOTHING, _bare(metrics.get("clearance_executed_m"), 1e3), "mm"),
        ComparisonRow(f"arm to the obstacle's body, {EXECUTED}", NOTHING, _gap(result), "mm"),
        ComparisonRow(
            f"points to the image's limits, {CERTIFIED}",
            "kept",
            _bound(certified_visibility(result), "px"),
            "px",
        ),
        ComparisonRow(f"… {EXECUTED}", "kept", _bare(metrics.get("visibility_executed_px")), "px"),
        ComparisonRow("at the goal", "converges", _at_goal(result), ""),
        ComparisonRow(
            "motion and structure, computing time",
            f"{paper.estimation_seconds:.3f} s",
            spell(result.seconds.get("estimation"), "s"),
            "",
        ),
        ComparisonRow(
            "path planning, computing time",
            f"{paper.planning_seconds:.3f} s",
            spell(result.seconds.get("planning"), "s"),
            "",
        ),
        ComparisonRow(
            "highest degrees of the path, rotation and translation",
            f"{paper.degree}, {paper.degree}",
            f"{degrees.rotation}, {degrees.translation}",
            "",
        ),
    )


def paper_table_markdown(results: Sequence[RunResult]) -> str:
    """Return the tables of all runs of the paper's tasks as one Markdown table; empty where there is none."""
    tables = [(r, comparison_table(r)) for r in results if r.task.name in PAPER]
    if not tables:
        return ""
    head = ["quantity", "unit"]
    for result, _ in tables:
        example = PAPER[result.task.name].example
        head += [f"example {example}: paper", f"example {example}: {result.method}"]
    lines = [_markdown_row(head), _markdown_row(["---"] * len(head))]
    for rows in zip(*(table for _, table in tables), strict=True):
        cells = [rows[0].quantity, rows[0].unit]
        for row in rows:
            cells += [row.paper, row.ours]
        lines.append(_markdown_row(cells))
    return "\n".join(lines) + "\n"


def _markdown_row(cells: Sequence[str]) -> str:
    return "| " + " | ".join(cell.replace("|", "\\|") for cell in cells) + " |"


def _smallest_planned(result: RunResult) -> float | None:
    """Return the smallest planned distance [m] to the obstacles without a clearance of their own."""
    curve = planned_curve(result)
    common = result.task.planning.common_obstacles
    return None if curve is None or not common else float(curve.clearances[:, common].min())


def _bare(value: object, factor: float = 1.0) -> str:
    return significant(factor * float(value)) if isinstance(value, int | float) else NOTHING


def _bound(value: float | None, unit: str) -> str:
    """Return a proven lower bound, rounded down, without its unit, which stands beside."""
    return spell_bound(value, unit).rsplit(" ", 1)[0]


def _gap(result: RunResult) -> str:
    touched = bool(result.log.contacts)
    gap = _bare(result.metrics.get("arm_clearance_executed_m"), 1e3)
    return f"{gap} (touches)" if touched else gap


def _at_goal(result: RunResult) -> str:
    if result.log.stop_reason:
        return f"stopped: {result.log.stop_reason.replace('_', ' ')}"
    names = (
        ("final_translation_error_m", "m"),
        ("final_rotation_error_rad", "rad"),
        ("final_error_px", "px"),
    )
    values = [(result.metrics.get(name), unit) for name, unit in names]
    return ", ".join(spell(v, unit) for v, unit in values if isinstance(v, int | float)) or NOTHING
