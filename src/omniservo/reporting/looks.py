"""The small moves before the plan after which more was known: what each cost and what it gained."""

from __future__ import annotations

import io

from PIL import Image

from omniservo.reporting.html import Cell, Markup, inlined, joined, table, tag
from omniservo.reporting.spelling import NOTHING, spell
from omniservo.results.run_result import RunResult
from omniservo.results.taken_look import Known, TakenLook


def looks_section(result: RunResult) -> Markup | None:
    """Return a table and the images of a run's looks; None where there was none."""
    if not result.looks:
        return None
    lead = tag(
        "p",
        "Where the arm stood first there was no plan. So it moved a little, along straight lines in joint "
        "space that were proven before, took another image and joined it to those before, with its own "
        "displacement as scale. What is written of the run begins after the last of these moves.",
    )
    columns = [
        "", "camera moved", "move, computing", "goal's position, σ", "goal's rotation, σ", "points, σ",
        "uncertainty left, expected / found", "samples that violate, bound",
    ]  # fmt: skip
    rows = [_row(number, look) for number, look in enumerate(result.looks, start=1)]
    reasons = [tag("li", _reason(number, look)) for number, look in enumerate(result.looks, start=1)]
    figures = [
        tag(
            "figure",
            inlined(_png(look), "png", f"image of look {number}"),
            tag("figcaption", f"Image of look {number}"),
        )
        for number, look in enumerate(result.looks, start=1)
    ]
    return joined(
        [lead, table(columns, rows), tag("ol", *reasons), tag("div", *figures, class_="columns of3")]
    )


def _row(number: int, look: TakenLook) -> list[Cell]:
    before, after = look.before, look.after
    return [
        f"look {number}",
        f"{spell(look.moved_m, 'm')}, {spell(look.turned_rad, 'rad')}",
        f"{spell(look.motion_seconds, 's')}, {spell(look.computing_seconds, 's')}",
        f"{spell(before.goal_m, 'm')} → {spell(after.goal_m, 'm')}",
        f"{spell(before.goal_rad, 'rad')} → {spell(after.goal_rad, 'rad')}",
        f"{spell(before.points_m, 'm')} → {spell(after.points_m, 'm')}",
        f"{100 * look.expected:.0f}% / {100 * look.gained:.0f}%",
        f"{_share(before)} → {_share(after)}",
    ]


def _share(known: Known) -> str:
    return NOTHING if known.violated is None else f"{100 * known.violated:.2g}%"


def _reason(number: int, look: TakenLook) -> str:
    if look.nothing:
        then = f"its image gave nothing: {look.nothing}; the arm went back"
    else:
        outcome = look.after.outcome
        then = f"then no plan either: {outcome}" if outcome else "then there was a plan"
    foreseen = (
        "a plan was expected from there" if look.leads_to_plan else "only less uncertainty was expected"
    )
    proven = f"gaps on the way keep {spell(look.clearance_m, 'm')} more than required"
    return f"Before look {number}: {look.before.outcome}; {foreseen}; {proven}; {then}."


def _png(look: TakenLook) -> bytes:
    buffer = io.BytesIO()
    Image.fromarray(look.image).save(buffer, format="PNG")
    return buffer.getvalue()
