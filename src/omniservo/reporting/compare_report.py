"""The HTML report of two studies side by side: one file that needs nothing else."""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from pathlib import Path

import numpy as np

from omniservo.files import write_whole
from omniservo.reporting.framed_figure import framed
from omniservo.reporting.html import Cell, Markup, banner, page, part, table, tag, whole
from omniservo.reporting.style import REQUIRED, SEVEN, Drawing, new_axes, styled
from omniservo.studies import MethodDifference, RateDifference, StudyHeader
from omniservo.studies.study_summary import Median, percent, with_interval

_MEDIANS = {
    "translation_m": ("final distance", ".2f", " mm", 1e3),
    "rotation_rad": ("final angle", ".3f", "°", math.degrees(1.0)),
    "path_length_m": ("path", ".2f", " m", 1.0),
    "seconds": ("time", ".1f", " s", 1.0),
}
_MOST_ROWS = 50
"""that are named of those that a method lost, and won"""


def write_compare_report(
    path: Path, headers: tuple[StudyHeader, StudyHeader], found: Sequence[MethodDifference], *, force: bool
) -> None:
    """Write the report.

    Raises:
        InputError: the file exists and ``force`` is False, or it cannot be written.
    """
    write_whole(path, _html(headers, found), force=force)


def _html(headers: tuple[StudyHeader, StudyHeader], found: Sequence[MethodDifference]) -> str:
    before, after = headers
    same = before.study.hash == after.study.hash
    summary = (
        "the same study, row by row"
        if same
        else "two studies: rates are compared as those of independent samples"
    )
    names = [
        [word, h.study.name, h.study.hash, h.version] for word, h in zip(("A", "B"), headers, strict=True)
    ]
    words = (
        "A → B, and below the interval of 95% of the difference in points (Newcombe 1998"
        f"{', for pairs' if same else ''}); bold where it leaves out zero. Medians are those of each study's "
        "successful runs, with the interval of each."
    )
    return page(
        f"{before.study.name} and {after.study.name}",
        [
            banner(f"{before.study.name} and {after.study.name}", summary),
            part("What is compared", table(["", "study", "hash", "version"], names)),
            part("Figures", tag("div", framed(_drawn(found), "wide"), class_="figures")),
            part("Rates", _rates(found), tag("p", words, class_="quiet")),
            part("Medians", _medians(found)),
            *([part("Rows that changed", _changed(found))] if any(e.lost or e.won for e in found) else []),
        ],
    )


def _drawn(found: Sequence[MethodDifference]) -> Drawing:
    with styled():
        figure, axes = new_axes(9.0, 1.4 + 0.4 * len(found))
        place = np.arange(len(found), dtype=np.float64)
        middle = 100.0 * np.array([each.success.difference for each in found])
        ends = 100.0 * np.array([each.success.interval for each in found])
        off = np.abs(np.array([middle - ends[:, 0], ends[:, 1] - middle]))
        axes.errorbar(middle, place, xerr=off, fmt="o", color=SEVEN[2], ecolor="#222222", capsize=2.5)
        axes.axvline(0.0, color=REQUIRED, ls=":", lw=1.6)
        axes.set_yticks(place, [each.method for each in found])
        axes.invert_yaxis()
        axes.set_xlabel("success of B over that of A [points]")
    return Drawing("difference", "Success", "Lines are intervals of 95% of the difference.", figure)


def _rates(found: Sequence[MethodDifference]) -> Markup:
    shown = [name for name in found[0].rates if any(e.rates[name].before.of for e in found)]
    lines: Iterable[list[Cell]] = (
        [each.method, *(_rate(each.rates[name]) for name in shown)] for each in found
    )
    return table(["method", *(name.replace("_", " ") for name in shown)], lines)


def _rate(rate: RateDifference) -> Markup:
    if not (rate.before.of and rate.after.of):
        return Markup("–")
    low, high = rate.interval
    words = f"{percent(rate.before)} → {percent(rate.after)}"
    apart = whole(f"({100 * low:+.1f} to {100 * high:+.1f})".replace("-", "−"))
    first = tag("strong" if rate.differs else "span", whole(words))
    return tag("span", first, Markup("<br>"), tag("small", apart, class_="quiet"))


def _medians(found: Sequence[MethodDifference]) -> Markup:
    def said(name: str, both: tuple[Median, Median]) -> str:
        _, form, unit, scale = _MEDIANS[name]
        return " → ".join(with_interval(each, form, unit, scale) for each in both)

    head = ["method", *(_MEDIANS[name][0] for name in found[0].medians)]
    lines = ([each.method, *(said(name, both) for name, both in each.medians.items())] for each in found)
    return table(head, lines)


def _changed(found: Sequence[MethodDifference]) -> Markup:
    def few(rows: tuple[int, ...]) -> str:
        more = f", … ({len(rows)})" if len(rows) > _MOST_ROWS else ""
        return (", ".join(map(str, rows[:_MOST_ROWS])) or "–") + more

    return table(["method", "lost by B", "won by B"], ([e.method, few(e.lost), few(e.won)] for e in found))
