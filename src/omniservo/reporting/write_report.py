"""The HTML report: one file that needs nothing else."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from types import MappingProxyType

from omniservo.errors import InputError
from omniservo.files import write_whole
from omniservo.reporting import report_sections as section
from omniservo.reporting.animation import animation_bytes
from omniservo.reporting.estimate_table import estimate_table
from omniservo.reporting.files_beside import files_beside
from omniservo.reporting.framed_figure import framed, in_page
from omniservo.reporting.html import Markup, banner, joined, page, part, tag
from omniservo.reporting.joint_section import joint_section
from omniservo.reporting.looks import looks_section
from omniservo.reporting.margin_parts import margin_parts
from omniservo.reporting.replanning import replanning_section
from omniservo.reporting.style import Drawing
from omniservo.reporting.waits_section import waits_section
from omniservo.reporting.write_figures import drawings
from omniservo.results.run_result import RunResult

_WIDE = 9.0
"""Figures wider than this [inch] get the page's whole width."""

_BESIDE = 3
"""So many methods at most stand in a row."""

_PICTURES = ("views", "outside")
"""Wide figures that are still legible at a third of the page."""


@dataclass(frozen=True)
class RunPictures:
    """What a run looks like; drawn once for its own files and for the report."""

    drawings: tuple[Drawing, ...]
    animation: bytes | None
    """a GIF file; None: not filmed"""


def write_report(
    folder: Path,
    results: Sequence[RunResult],
    pictures: Sequence[RunPictures] | None = None,
    refused: Mapping[str, str] = MappingProxyType({}),
) -> None:
    """Write ``report.html`` into the folder; an existing one is replaced.

    Images are part of the file; it loads nothing and runs nothing. Several results, methods on one task,
    are shown side by side.

    Args:
        folder: where to.
        results: of the runs.
        pictures: of each run; None: drawn now.
        refused: of methods that refused the task, by name, why.

    Raises:
        InputError: no result is given, or the folder cannot be written.
    """
    if not results:
        raise InputError("results: none given; at least one is needed")
    drawn = [_pictures(r) for r in results] if pictures is None else pictures
    page = report_html(results, drawn, folder if folder.is_dir() else None, refused)
    write_whole(folder / "report.html", page, force=True)


def report_html(
    results: Sequence[RunResult],
    pictures: Sequence[RunPictures],
    folder: Path | None = None,
    refused: Mapping[str, str] = MappingProxyType({}),
) -> str:
    """Return the report's text; it lists the files of ``folder``, in which it will stand.

    ``refused`` says of methods without a run why they have none.
    """
    task = results[0].task
    drawn = [p.drawings for p in pictures]
    beside = None if folder is None else files_beside(folder, {d.name: d.title for d in drawn[0]})
    several = len(results) > 1
    body = [
        banner(task.name, task.summary),
        _verdicts(results, refused),
        *([] if several else [section.key_numbers(results[0])]),
        *([part("The methods side by side", section.side_by_side(results))] if several else []),
        *(_animations(results, [p.animation for p in pictures])),
        *_parts("The paper's numbers and ours", section.paper_and_ours, results[:1]),
        *_parts("Looks before the plan", looks_section, results),
        part("Figures", *_figures(results, drawn)),
        *_parts("During the motion", replanning_section, results),
        *_parts("Waiting for images", waits_section, results),
        *_parts("Joint path", joint_section, results),
        *(part(_named("In detail", r, results), *_details(r)) for r in results),
        part(
            "How to reproduce this",
            section.reproduce(results),
            *([tag("details", tag("summary", "Files beside this page"), beside)] if beside else []),
        ),
    ]
    return page(task.name, body)


def _verdicts(results: Sequence[RunResult], refused: Mapping[str, str]) -> Markup:
    """Return a box for each method."""
    named = len(results) + len(refused) > 1
    boxes = [section.verdict(r, named=named) for r in results]
    boxes += [section.refusal(name, why) for name, why in refused.items()]
    return tag("div", *boxes, class_=f"columns of{min(len(boxes), _BESIDE)}")


def _pictures(result: RunResult) -> RunPictures:
    return RunPictures(tuple(drawings(result)), animation_bytes(result) if result.is_filmed else None)


def _animations(results: Sequence[RunResult], films: Sequence[bytes | None]) -> list[Markup]:
    shown = [section.animation(f, r) for f, r in zip(films, results, strict=True) if f is not None]
    if len(shown) < len(results):
        return []
    if len(results) == 1:
        return [tag("section", *shown, class_="film")]
    named = [
        tag("div", joined([tag("h3", section.title_of(r)), s])) for r, s in zip(results, shown, strict=True)
    ]
    return [tag("section", tag("h2", "The runs"), tag("div", *named, class_="columns of2"))]


def _figures(results: Sequence[RunResult], per_run: Sequence[Sequence[Drawing]]) -> list[Markup]:
    """Return every figure: of one run in reading order, of several beside each other figure by figure."""
    if len(results) == 1:
        return [
            tag("div", *(framed(d, "wide" if _is_wide(d) else "half") for d in per_run[0]), class_="figures")
        ]
    names = list(dict.fromkeys(d.name for run in per_run for d in run))
    found = [
        [(r, d) for r, run in zip(results, per_run, strict=True) for d in run if d.name == name]
        for name in names
    ]
    return [block for same in found for block in _beside_each_other(same, len(results))]


def _beside_each_other(same: Sequence[tuple[RunResult, Drawing]], columns: int) -> list[Markup]:
    """Return one kind of figure of several runs; what all captions say is said once."""
    first = same[0][1]
    agreed = all(drawing.caption == first.caption for _, drawing in same)
    alone = _is_wide(first) and first.name not in _PICTURES
    figures = []
    for result, drawing in same:
        words = [] if agreed else [tag("p", drawing.caption, class_="caption")]
        named = tag("figcaption", tag("strong", section.title_of(result)))
        alternative = f"{drawing.title} {section.title_of(result)}".strip()
        figures.append(tag("figure", named, in_page(drawing, alternative), *words))
    return [
        tag("h3", first.title),
        *([tag("p", first.caption, class_="caption")] if agreed else []),
        tag("div", *figures, class_="columns" if alone else f"columns of{min(columns, _BESIDE)}"),
    ]


def _is_wide(drawing: Drawing) -> bool:
    return float(drawing.figure.get_size_inches()[0]) > _WIDE


def _parts(
    title: str, of: Callable[[RunResult], Markup | None], results: Sequence[RunResult]
) -> list[Markup]:
    """Return a part for every run that has it; of several runs each is named by its method."""
    found = [(result, of(result)) for result in results]
    return [part(_named(title, r, results), content) for r, content in found if content is not None]


def _named(title: str, result: RunResult, results: Sequence[RunResult]) -> str:
    return f"{title}: {section.title_of(result)}" if len(results) > 1 else title


def _details(result: RunResult) -> list[Markup]:
    """Return the tables for those who want to know exactly."""
    proof, risk, kept = section.certificate(result), section.risk(result), margin_parts(result)
    return [
        tag("details", tag("summary", "All metrics"), section.metrics(result)),
        *([tag("details", tag("summary", "Certificate"), proof)] if proof is not None else []),
        *([tag("details", tag("summary", "Uncertainty and risk"), risk)] if risk is not None else []),
        *([tag("details", tag("summary", "What margins are made of"), kept)] if kept is not None else []),
        tag("details", tag("summary", "Motion and structure"), estimate_table(result.estimate)),
        tag("details", tag("summary", "Computing times"), section.timings(result)),
    ]
