"""The HTML report of a study: one file that needs nothing else."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from pathlib import Path

from omniservo.files import write_whole
from omniservo.reporting.framed_figure import framed
from omniservo.reporting.html import Cell, Markup, banner, page, part, table, tag, whole
from omniservo.reporting.study_figures import draw_row, study_drawings
from omniservo.studies import MethodSummary, Program, Rate, StudyHeader, StudyTally, run_row
from omniservo.studies.study_arms import NO_ARM
from omniservo.studies.study_row import DIVERGED
from omniservo.studies.study_summary import percent_with_interval, with_interval

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
        *_figures(tally),
        part("How runs ended", *_endings(found)),
    ]
    worst = tally.worst(_WORST)
    if worst and program.version != header.version:
        words = f"Not drawn: the rows were run by {header.version}, and this is {program.version}."
        body.append(part("The worst", tag("p", words)))
    elif worst:
        figures = (framed(draw_row(run_row(study, row.row, program)), "half") for row in worst)
        words = (
            "Rows without success: crashes, collisions, the largest final errors, and last what never moved. "
            "Two of each method come before others."
        )
        body.append(part("The worst", tag("p", words), tag("div", *figures, class_="figures")))
    body.append(part("What it was run with", _run_with(header)))
    return page(f"study {study.name}", body)


def _figures(tally: StudyTally) -> list[Markup]:
    drawn = [framed(drawing, "wide") for drawing in study_drawings(tally)]
    return [part("Figures", tag("div", *drawn, class_="figures"))] if drawn else []


def _table(found: Sequence[MethodSummary]) -> Markup:
    carried = any(each.joint_limit.of for each in found)
    head = ["method", "success", "collision", *(["joint limit"] * carried), "feature lost", "diverged",
            "final distance", "final angle", "path", "time"]  # fmt: skip
    lines: list[list[Cell]] = []
    for each in found:
        rates = (each.success, each.collision, *([each.joint_limit] * carried), each.feature_lost,
                 each.diverged)  # fmt: skip
        medians = (
            with_interval(each.translation_m, ".2f", " mm", 1e3),
            with_interval(each.rotation_rad, ".3f", "°", math.degrees(1.0)),
            with_interval(each.path_length_m, ".2f", " m"),
            with_interval(each.seconds, ".1f", " s"),
        )
        lines.append([each.method, *map(_rate, rates), *map(_parted, medians)])
    return table(head, lines)


def _rate(rate: Rate) -> Markup:
    return _parted(percent_with_interval(rate), *([f"{rate.count} of {rate.of}"] if rate.of else []))


def _parted(words: str, *more: str) -> Markup:
    """Return a value with its interval in a line below, and what else there is to say below that."""
    value, bracket, interval = words.partition(" (")
    lines = [value, *([f"({interval}"] if bracket else []), *more]
    first, *rest = (whole(line).html for line in lines)
    return Markup("<br>".join([first, *(f'<small class="quiet">{line}</small>' for line in rest)]))


def _with_arms(found: Sequence[MethodSummary]) -> list[Markup]:
    """Return what methods do with each arm and without; nothing where no camera was carried by one."""
    if all(set(each.arms) <= {NO_ARM} for each in found):
        return []
    head = ["method", "arm", "success", "collision", "joint limit"]
    lines: list[list[Cell]] = []
    for each in found:
        for arm, rates in each.arms.items():
            lines.append(
                [
                    each.method,
                    arm,
                    *map(_rate, (rates.success, rates.collision, rates.joint_limit)),
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
        f"target. Distances, angles, paths and times are medians of the successful runs. In brackets: the "
        f"interval of 95%, Wilson's of shares, of medians whatever their distribution.{left}"
    )


def _endings(found: Sequence[MethodSummary]) -> list[Markup]:
    """Return how often a method's runs ended in which way, and by which names they were stopped."""
    ways = [_counted("method", {each.method: each.statuses for each in found})]
    if any(each.stops for each in found):
        ways.append(_counted("stopped by", {each.method: each.stops for each in found}))
    return ways


def _counted(head: str, counts: Mapping[str, Mapping[str, int]]) -> Markup:
    kinds = sorted({kind for each in counts.values() for kind in each})
    lines = ([method, *(str(own.get(kind, 0)) for kind in kinds)] for method, own in counts.items())
    return table([head, *(kind.replace("_", " ") for kind in kinds)], lines)


def _run_with(header: StudyHeader) -> Markup:
    lines = [["study", f"{header.study.name} {header.study.hash}"], ["version", header.version]]
    for machine in header.machines:
        lines.append(["machine", ", ".join(f"{name} {value}" for name, value in machine.items())])
    lines.append(["repeat a row", "omniservo run --replay STUDY:ROW"])
    return table(["", ""], lines)
