"""The HTML report of a study: one file that needs nothing else."""

from __future__ import annotations

import math
from collections.abc import Sequence
from pathlib import Path

from omniservo.files import write_whole
from omniservo.reporting.framed_figure import framed
from omniservo.reporting.html import Markup, banner, page, part, table, tag, whole
from omniservo.reporting.study_figures import draw_row, study_drawings
from omniservo.studies import MethodSummary, Program, StudyHeader, StudyTally, run_row
from omniservo.studies.study_arms import NO_ARM
from omniservo.studies.study_row import DIVERGED
from omniservo.studies.study_summary import errors, number, percent

_WORST = 10


def write_study_report(header: StudyHeader, tally: StudyTally, path: Path, program: Program) -> None:
    """Write the report, with figures of the worst rows, which are run again for it.

    A program of another version than the rows' would run others: then there are no such figures.

    Raises:
        InputError: it cannot be written.
    """
    write_whole(path, study_html(header, tally, program), force=True)


def study_html(header: StudyHeader, tally: StudyTally, program: Program) -> str:
    """Return the report's text."""
    study, found = header.study, tally.summaries()
    summary = (
        f"{tally.rows} closed loops: {study.scenes} scenes for each camera ({', '.join(study.cameras)}), "
        f"{len(study.methods)} methods on the same scenes"
    )
    body: list[Markup] = [
        banner(f"Study {study.name}", summary),
        part("By method", _table(found), tag("p", _limits(header, tally.without), class_="quiet")),
        *_with_arms(found),
        part(
            "Figures",
            tag("div", *(framed(drawing, "wide") for drawing in study_drawings(tally)), class_="figures"),
        ),
        part("How runs ended", _endings(found)),
    ]
    worst = tally.worst(_WORST)
    if worst and program.version != header.version:
        words = f"Not drawn: the rows were run by {header.version}, and this is {program.version}."
        body.append(part("The worst", tag("p", words)))
    elif worst:
        figures = (framed(draw_row(run_row(study, row.row, program)), "half") for row in worst)
        words = "Rows without success: collisions, then the largest final errors; two of a method at most."
        body.append(part("The worst", tag("p", words), tag("div", *figures, class_="figures")))
    body.append(part("What it was run with", _run_with(header)))
    return page(f"study {study.name}", body)


def _table(found: Sequence[MethodSummary]) -> Markup:
    head = ["method", "success", "95% interval", "collision", "feature lost", "diverged",
            "final error, median", "path, median", "time, median"]  # fmt: skip
    lines = []
    for each in found:
        low, high = each.success.interval
        lines.append(
            [
                each.method,
                f"{percent(each.success)} ({each.success.count} of {each.success.of})",
                f"{100 * low:.1f}–{100 * high:.1f}%",
                f"{percent(each.collision)} ({each.collision.count} of {each.collision.of})",
                percent(each.feature_lost),
                percent(each.diverged),
                errors(each),
                number(each.path_length_m, ".2f", " m"),
                number(each.seconds, ".1f", " s"),
            ]
        )
    return table(head, ([whole(cell) for cell in line] for line in lines))


def _with_arms(found: Sequence[MethodSummary]) -> list[Markup]:
    """Return what methods do with each arm and without; nothing where no camera was carried by one."""
    if all(set(each.arms) <= {NO_ARM} for each in found):
        return []
    head = ["method", "arm", "success", "95% interval", "collision", "joint limit"]
    lines = []
    for each in found:
        for arm, rates in each.arms.items():
            low, high = rates.success.interval
            lines.append(
                [
                    each.method,
                    arm,
                    f"{percent(rates.success)} ({rates.success.count} of {rates.success.of})",
                    f"{100 * low:.1f}–{100 * high:.1f}%",
                    f"{percent(rates.collision)} ({rates.collision.count} of {rates.collision.of})",
                    percent(rates.joint_limit),
                ]
            )
    words = (
        "Collision with an arm: the camera as without, or a link or the camera's housing touched an "
        "obstacle, the floor or another link. Joint limit: the arm was stopped because a joint would have "
        "left its range, or because it was singular."
    )
    return [part("With an arm and without", table(head, lines), tag("p", words, class_="quiet"))]


def _limits(header: StudyHeader, without: int) -> str:
    limits, study = header.study.limits, header.study
    left = f" {without} rows had no scene and are left out." if without else ""
    return (
        f"Success: within {1e3 * limits.translation:g} mm and {math.degrees(limits.rotation):.3g}° of the "
        f"goal after {limits.seconds:g} s at most, and the camera's centre never within "
        f"{1e3 * study.obstacles.clearance:g} mm of an obstacle. Collision: of the runs with an obstacle "
        f"or an arm. Diverged: not at the goal, and once {DIVERGED:g} times as far from it as start and "
        f"target. Medians are those of successful runs.{left}"
    )


def _endings(found: Sequence[MethodSummary]) -> Markup:
    kinds = sorted({status for each in found for status in each.statuses})
    head = ["method", *(kind.replace("_", " ") for kind in kinds)]
    return table(head, ([each.method, *(str(each.statuses.get(k, 0)) for k in kinds)] for each in found))


def _run_with(header: StudyHeader) -> Markup:
    lines = [["study", f"{header.study.name} {header.study.hash}"], ["version", header.version]]
    for machine in header.machines:
        lines.append(["machine", ", ".join(f"{name} {value}" for name, value in machine.items())])
    lines.append(["repeat a row", "omniservo run --replay STUDY:ROW"])
    return table(["", ""], lines)
