"""``omniservo run --replay STUDY:ROW``."""

from __future__ import annotations

import re
from collections.abc import Sequence
from pathlib import Path

from omniservo.cli.output import Output
from omniservo.errors import InputError
from omniservo.files import write_whole
from omniservo.run_methods import METHODS
from omniservo.shipped_studies import study_file

_ROW = re.compile(r"(?P<study>.+):(?P<row>\d{1,9})")


def is_row(given: Path) -> bool:
    """Return whether ``STUDY:ROW`` is given, not a recording's file."""
    return _ROW.fullmatch(str(given)) is not None and not given.exists()


def replay_row(given: Path, own: Sequence[str], output: Output) -> None:
    """Run a study's row again, print it, and draw it beside.

    Args:
        given: ``STUDY:ROW``.
        own: ``FILE.py:CLASS`` of the study's methods from files, whose code is run.
        output: takes what is printed.

    Raises:
        InputError: no such study, or no such row, or it is of a method from a file that is not given.
    """
    found = _ROW.fullmatch(str(given))
    name, number = (found["study"], int(found["row"])) if found else (str(given), -1)
    folder = Path(name)
    if not folder.is_dir():
        study_file(name)
    with output.working("loading") as progress:
        from omniservo.reporting.figure_files import image_bytes
        from omniservo.reporting.study_figures import draw_row
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
        picture = Path(f"{study.name}-row-{number}.png")
        write_whole(picture, image_bytes(draw_row(result), "png"), force=True)
    if header is not None and header.version != program.version:
        output.line(f"{folder}: its rows were run by {header.version}; this is {program.version}")
    row = fields_of_row(result.row)
    for field, value in row.items():
        output.line(f"{field:<28}{'–' if value is None else value}")
    output.written(picture)
    output.result({**row, "figure": str(picture)}, "run-replay-row")
