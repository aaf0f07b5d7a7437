"""``omniservo run --replay STUDY:ROW``."""

from __future__ import annotations

import re
from collections.abc import Sequence
from pathlib import Path

from omniservo.cli.output import Output
from omniservo.errors import InputError
from omniservo.files import unused, whole_folder, writable_folder
from omniservo.run_methods import METHODS
from omniservo.shipped_studies import study_file

_FILE = "row.json"
"""in every folder of a row that was repeated"""

_ROW = re.compile(r"(?P<study>.+):(?P<row>\d{1,9})")


def is_row(given: Path) -> bool:
    """Return whether ``STUDY:ROW`` is given, not a recording's file."""
    return _ROW.fullmatch(str(given)) is not None and not given.exists()


def replay_row(given: Path, own: Sequence[str], out: Path | None, force: bool, output: Output) -> None:
    """Run a study's row again and print it; its images, figures and report are written into a folder.

    Args:
        given: ``STUDY:ROW``.
        own: ``FILE.py:CLASS`` of the study's methods from files, whose code is run.
        out: the folder; None: runs/NAME-row-ROW, with a number where it exists.
        force: an existing folder may be replaced.
        output: takes what is printed.

    Raises:
        InputError: no such study, or no such row, or it is of a method from a file that is not given.
    """
    found = _ROW.fullmatch(str(given))
    name, number = (found["study"], int(found["row"])) if found else (str(given), -1)
    folder = Path(name)
    if not folder.is_dir():
        study_file(name)
    if out is not None:
        writable_folder(out, _FILE, force=force)
    with output.working("loading") as progress:
        from omniservo.reporting.row_report import FIGURE, REPORT, write_row_report
        from omniservo.studies import Program, fields_of_row, load_study, read_header, run_row

        header = read_header(folder) if folder.is_dir() else None
        program = Program.of(own)
        study = load_study(name, program.names) if header is None else header.study
        if not 0 <= number < study.rows:
            raise InputError(f"--replay: row {number} given; {name} has rows 0 to {study.rows - 1}")
        if (method := study.place(number)[2]) not in (*METHODS, *program.names):
            raise InputError(
                f"--replay: row {number} is of {method}, whose code is not kept with the study; needed: "
                f"--method FILE.py:CLASS"
            )
        progress(f"running row {number}")
        result = run_row(study, number, program)
        progress("drawing it")
        target = _folder(study.name, number, force) if out is None else out
        with whole_folder(target, _FILE, force=force) as work:
            write_row_report(work, study, result)
    if header is not None and header.version != program.version:
        output.line(f"{folder}: its rows were run by {header.version}; this is {program.version}")
    row = fields_of_row(result.row)
    for field, value in row.items():
        output.line(f"{field:<28}{'–' if value is None else value}")
    output.written(target / REPORT)
    output.result({**row, "figure": str(target / FIGURE), "out": str(target)}, "run-replay-row")


def _folder(name: str, number: int, force: bool) -> Path:
    folder = Path("runs") / f"{name}-row-{number}"
    return folder if force else unused(folder)
