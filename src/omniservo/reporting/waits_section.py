"""When a run waited for images, and why."""

from __future__ import annotations

from omniservo.reporting.html import Cell, Markup, joined, table, tag
from omniservo.reporting.spelling import spell
from omniservo.results.run_result import RunResult


def waits_section(result: RunResult) -> Markup | None:
    """Return a table of every time when images were missing; None where there was none."""
    log = result.log
    if not log.waits:
        return None
    rows: list[list[Cell]] = [
        [
            f"{wait.since:.3f} s",
            wait.why,
            f"{wait.stands_at:.3f} s",
            f"{wait.until:.3f} s",
            spell(log.moved_blind(wait), "m"),
        ]
        for wait in log.waits
    ]
    lead = (
        "Where no image can be acted on, the arm slows down along its path by the joints alone, stands, and "
        "waits. It goes on when an image shows the points where the joints have them."
    )
    head = ["slowed down from", "why", "stood from", "until", "camera moved between the images round it"]
    return joined([tag("p", lead), table(head, rows)])
