"""``omniservo run --replay STUDY:ROW``."""

from __future__ import annotations

import re
from pathlib import Path

from omniservo.cli.output import Output
from omniservo.errors import InputError
from omniservo.files import write_whole
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
        from omniservo.studies import fields_of_row, load_study, read_header, run_row

        study = read_header(folder).study if folder.is_dir() else load_study(name)
        if not 0 <= number < study.rows:
            raise InputError(f"--replay: row {number} given; {name} has rows 0 to {study.rows - 1}")
        progress(f"running row {number}")
        result = run_row(study, number)
        picture = Path(f"{study.name}-row-{number}.png")
        write_whole(picture, image_bytes(draw_row(result), "png"), force=True)
    row = fields_of_row(result.row)
    for field, value in row.items():
        output.line(f"{field:<28}{'–' if value is None else value}")
    output.written(picture)
    output.result({**row, "figure": str(picture)})
