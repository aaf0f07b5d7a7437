"""``omniservo study``."""

from __future__ import annotations

import os
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer
from typer.core import TyperGroup

from omniservo.cli.grouped import grouped
from omniservo.cli.output import ForceOption, Output
from omniservo.cli.progress import DOING, Progress
from omniservo.files import whole_folder, writable
from omniservo.shipped_studies import shipped_studies, study_file

if TYPE_CHECKING:
    from omniservo.studies import MethodDifference, MethodSummary, Program, StudyHeader, StudyRow

_RUN = "run"


class _StudyGroup(TyperGroup):
    """``omniservo study STUDY`` is ``omniservo study run STUDY``."""

    default = _RUN

    def parse_args(self, ctx: typer.Context, args: list[str]) -> list[str]:  # type: ignore[override]
        """Put the command's name before what is not one."""
        if args and args[0] not in (*self.commands, "--help"):
            args = [self.default, *args]
        return super().parse_args(ctx, args)


app = typer.Typer(
    cls=_StudyGroup,
    help="Run many closed loops over stated distributions: omniservo study STUDY --out DIR.",
    no_args_is_help=True,
)

StudyArgument = Annotated[
    str, typer.Argument(help=f"A study file, or a shipped study: {', '.join(shipped_studies())}.")
]
WorkersOption = Annotated[
    int | None, typer.Option("--workers", min=1, help="Processes; default one for each core.")
]
SchedulerOption = Annotated[
    str | None,
    typer.Option("--scheduler", metavar="ADDRESS", help="Run on a Dask cluster, such as tcp://HOST:8786."),
]
MethodFileOption = Annotated[
    list[str] | None,
    typer.Option(
        "--method-file", metavar="FILE.py:CLASS", help="Also run a method of your own: its code is run."
    ),
]
ShardOption = Annotated[
    str | None,
    typer.Option("--shard", metavar="K/N", help="The K-th of N shares; study merge joins them."),
]
FoldersArgument = Annotated[list[Path], typer.Argument(metavar="DIR…", help="Folders of the study's shards.")]


@app.command(_RUN)
@grouped
def run(
    study: StudyArgument,
    out: Annotated[Path, typer.Option("--out", help="Folder of the rows; an existing one is gone on with.")],
    *,
    workers: WorkersOption = None,
    scheduler: SchedulerOption = None,
    method_file: MethodFileOption = None,
    shard: ShardOption = None,
    output: Output,
) -> None:
    """Run a study; the same command goes on with one that was interrupted.

    DIR holds rows.parquet (rows.csv where pyarrow is not installed), report.html, the parts that rows are
    kept in, and study.json. The word run may be left out.
    """
    study_file(study)
    # before NumPy is loaded: rows that this process runs are then those of one-thread workers
    os.environ.update(dict.fromkeys(("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS"), "1"))
    with output.working("loading") as progress:
        from omniservo.studies import Program, Shard, load_study, run_study

        share = None if shard is None else Shard.parse(shard)
        program = Program.of(method_file or ())
        loaded = load_study(study, program.names)
        DOING.written.append(out)  # whoever ends it finds its finished parts there
        whole = run_study(
            loaded, out, program=program, workers=workers, scheduler=scheduler, shard=share, progress=progress
        )
        if whole:
            done = _finished(out, program, progress)
    if not whole:
        output.line(f"{out}: this share is done; omniservo study merge joins the folders of all")
        output.result({"status": "share done", "out": str(out), "study_hash": loaded.hash}, "study-share")
        return
    _say(output, out, done)


@app.command("merge")
@grouped
def merge(
    folders: FoldersArgument,
    *,
    out: Annotated[Path, typer.Option("--out", help="Folder of the whole study.")],
    force: ForceOption = False,
    output: Output,
) -> None:
    """Join the folders of a study's shards; every certificate is verified again."""
    with output.working("loading") as progress:
        from omniservo.studies import Program, merge_studies

        with whole_folder(out, "study.json", force=force) as work:
            _, certificates = merge_studies(folders, work, progress)
            done = _finished(work, Program(), progress)
    output.line(f"{certificates} certificates verified again")
    _say(output, out, done)


@app.command("compare")
@grouped
def compare(
    before: Annotated[Path, typer.Argument(metavar="A", help="Folder of a study.")],
    after: Annotated[Path, typer.Argument(metavar="B", help="Folder of another.")],
    *,
    out: Annotated[Path | None, typer.Option("--out", help="Write a report: an HTML file.")] = None,
    force: ForceOption = False,
    output: Output,
) -> None:
    """Compare each method in two studies; rows one by one where both ran the same study."""
    if out is not None:
        writable(out, force=force)
    with output.working("loading") as progress:
        from omniservo.studies import compare_studies, read_header, read_parts

        both = ((row for part in read_parts(d, progress) for row in part.rows) for d in (before, after))
        found = compare_studies(*both)
        if out is not None:
            from omniservo.reporting.compare_report import write_compare_report

            progress("writing the report")
            write_compare_report(out, (read_header(before), read_header(after)), found, force=force)
    for each in found:
        _say_difference(output, each)
    if out is not None:
        output.written(out)
    output.result({"methods": [each.to_dict() for each in found]}, "study-compare")


def _say_difference(output: Output, each: MethodDifference) -> None:
    """Print a line of a method's success, and one of each other rate that changed."""
    rows = f"; lost rows {_few(each.lost)}; won rows {_few(each.won)}" if each.lost or each.won else ""
    for name, rate in each.rates.items():
        if name != "success" and not abs(rate.difference) > 0.0:  # equal, or of nothing
            continue
        low, high = rate.interval
        what = each.method if name == "success" else f"  {name.replace('_', ' ')}"
        output.line(
            f"{what:<15} {100 * rate.before.share:6.1f}% → {100 * rate.after.share:.1f}%  "
            f"difference {100 * low:+.1f} to {100 * high:+.1f} points (95%)"
            f"{'' if rate.differs else ', which may be none'}{rows if name == 'success' else ''}"
        )


def _few(rows: tuple[int, ...]) -> str:
    shown = ", ".join(map(str, rows[:10])) or "none"
    return f"{shown}, … ({len(rows)})" if len(rows) > 10 else shown


@dataclass(frozen=True)
class _Finished:
    """A whole study."""

    header: StudyHeader
    rows: int
    found: list[MethodSummary]
    cpu_seconds: dict[str, float]
    """method → of one row, on average; of those who computed it"""


def _finished(folder: Path, program: Program, progress: Progress) -> _Finished:
    """Write table and report of a folder with all parts, which are read once, one after the other."""
    from omniservo.reporting.study_report import write_study_report
    from omniservo.studies import StudyTally, read_header, read_parts, write_rows

    header, tally = read_header(folder), StudyTally()
    taken = dict.fromkeys(header.study.methods, 0.0)

    def rows() -> Iterator[StudyRow]:
        for part in read_parts(folder):
            for method, seconds in part.cpu_seconds.items():
                taken[method] += seconds
            for row in part.rows:
                tally.add(row)
                yield row

    write_rows(folder, rows())
    progress("writing the report")
    write_study_report(header, tally, folder / "report.html", program)
    each = tally.rows / len(taken)
    cpu_seconds = {method: seconds / each for method, seconds in taken.items()}
    return _Finished(header, tally.rows, tally.summaries(), cpu_seconds)


def _of_arms(each: MethodSummary) -> str:
    """Return how often joints stopped the arm; nothing where there is none."""
    from omniservo.studies.study_summary import percent

    return f"joint limit {percent(each.joint_limit):>6}  " if each.joint_limit.of else ""


def _say(output: Output, out: Path, done: _Finished) -> None:
    from omniservo.studies.study_rows import CSV, PARQUET
    from omniservo.studies.study_summary import percent

    for each in done.found:
        low, high = (100 * end for end in each.success.interval)
        output.line(
            f"{each.method:<15} success {percent(each.success):>6} ({low:.0f} to {high:.0f}%)  "
            f"collision {percent(each.collision):>6} of {each.collision.of}  {_of_arms(each)}"
            f"feature lost {percent(each.feature_lost):>6}  {done.cpu_seconds[each.method]:.2f} CPU s a row"
        )
    output.written(out / "report.html")
    if (out / PARQUET).exists():
        output.written(out / PARQUET)
    else:
        output.written(out / CSV, f"; {PARQUET} needs: pip install omniservo[study]")
    output.result(
        {
            "status": "done",
            "study": done.header.study.name,
            "study_hash": done.header.study.hash,
            "version": done.header.version,
            "rows": done.rows,
            "methods": [each.to_dict() for each in done.found],
            "cpu_seconds_per_row": done.cpu_seconds,
            "out": str(out),
        },
        "study",
    )
