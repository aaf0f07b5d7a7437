"""``omniservo run --replay STUDY:ROW``."""

from __future__ import annotations

import re
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


def replay_row(given: Path, output: Output) -> None:
    """Run a study's row again, print it, and draw it beside.

    Raises:
        InputError: no such study, or no such row.
    """
    found = _ROW.fullmatch(str(given))
    name, number = (found["study"], int(found["row"])) if found else (str(given), -1)
    folder = Path(name)
    if not folder.is_dir():
        study_file(name)
    with output.working("loading") as progress:
        from omniservo.reporting.figure_files import image_bytes
        from omniservo.reporting.study_figures import draw_row
        from omniservo.studies import PACKAGE, fields_of_row, load_study, read_header, run_row

        header = read_header(folder) if folder.is_dir() else None
        study = load_study(name) if header is None else header.study
        if not 0 <= number < study.rows:
            raise InputError(f"--replay: row {number} given; {name} has rows 0 to {study.rows - 1}")
        if (method := study.place(number)[2]) not in METHODS:
            raise InputError(f"--replay: row {number} is of {method}, whose code is not kept with the study")
        progress(f"running row {number}")
        result = run_row(study, number)
        picture = Path(f"{study.name}-row-{number}.png")
        write_whole(picture, image_bytes(draw_row(result), "png"), force=True)
    if header is not None and header.version != PACKAGE.version:
        output.line(f"{folder}: its rows were run by {header.version}; this is {PACKAGE.version}")
    row = fields_of_row(result.row)
    for field, value in row.items():
        output.line(f"{field:<28}{'–' if value is None else value}")
    output.written(picture)
    output.result({**row, "figure": str(picture)}, "run-replay-row")
