"""The report's table of what every margin is made of."""

from __future__ import annotations

from omniservo.reporting.html import Cell, Markup, joined, table, tag
from omniservo.reporting.spelling import NOTHING, spell
from omniservo.results.run_result import RunResult


def margin_parts(result: RunResult) -> Markup | None:
    """Return required clearance, estimate, mount and tracking side by side; None where nothing is kept.

    Of the arm's links and of the camera's centre [m], and of the points in the image [px].
    """
    whole, risk, planning = result.whole_arm, result.risk, result.task.planning
    links = None if whole is None else whole.margin
    tube = None if whole is None else whole.tube
    if tube is None and risk is None:
        return None
    camera = (
        None
        if risk is None
        else max((m.planned - m.executed for m in risk.margins.values() if m.unit == "m"), default=None)
    )
    image = None if risk is None else risk.margins.get("image")
    tracking = None if tube is None else max(tube.links.values())
    rows: list[list[Cell]] = [
        [
            "required",
            spell(planning.arm_clearance, "m"),
            spell(planning.clearance, "m"),
            spell(planning.visibility_margin, "px"),
        ],
        [
            "taken by the estimate",
            spell(None if links is None else links.estimate, "m"),
            spell(camera, "m"),
            spell(None if image is None else image.planned - image.executed, "px"),
        ],
        ["taken by the camera's mount", spell(None if links is None else links.mount, "m"), NOTHING, NOTHING],
        [
            "added for both",
            spell(None if links is None else links.added, "m"),
            spell(None if risk is None else risk.extra_clearance, "m"),
            spell(None if risk is None else risk.extra_visibility, "px"),
        ],
        [
            "added for tracking",
            spell(planning.tracking_margin if tube is None else tracking, "m"),
            spell(planning.tracking_margin if tube is None else tube.position, "m"),
            spell(None if tube is None else tube.image, "px"),
        ],
    ]
    lead = tag("p", _lead(result))
    return joined([lead, table(["", "links", "camera's centre", "points in the image"], rows)])


def _lead(result: RunResult) -> str:
    whole, risk, asked = result.whole_arm, result.risk, result.task.planning.risk
    if asked is None or risk is None:
        return "No risk is stated: estimate and mount are taken as exact."
    parts = [f"{100 * risk.risk:g}% to what estimate and camera do to the camera's constraints"]
    if risk.links is not None:
        parts.append(f"{100 * risk.links.risk:g}% to what estimate and mount do to the arm's gaps")
    if whole is not None and whole.tube is not None:
        parts.append(f"{100 * whole.tube.share:g}% to runs that leave the tracking tube")
    return f"The plan was made for a risk of {100 * asked:g}%: {', '.join(parts)}."
