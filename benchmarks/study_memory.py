"""How much memory a study's table, report and comparison take, by the number of its rows.

Run: ``python -m benchmarks.study_memory [ROWS …]``. The rows are copies of 16 that are run, under other
numbers; they are written as parts, and read as those of every study are. Each count has a process of its own.
Merging is left out: it judges every certificate again, which takes minutes, and holds one part at a time.
"""

from __future__ import annotations

import resource
import subprocess
import sys
import tempfile
from dataclasses import replace
from pathlib import Path
from time import perf_counter
from unittest.mock import patch

from omniservo.reporting.study_report import write_study_report
from omniservo.studies import (
    PACKAGE,
    RowResult,
    StudyHeader,
    StudyTally,
    compare_studies,
    load_study,
    read_header,
    read_parts,
    run_row,
    write_rows,
)
from omniservo.studies.study_folder import HEADER
from omniservo.studies.study_parts import PartWork, part_count, write_part


def main() -> None:
    """Print a line for each count."""
    for rows in sys.argv[1:] or ["1000", "10000", "100000"]:
        subprocess.run(
            [sys.executable, "-c", f"from benchmarks.study_memory import measure; measure({rows})"],
            check=True,
        )


def measure(rows: int) -> None:
    """Print the peak before and after reading so many rows."""
    quick = load_study("quick")
    study = quick.model_validate({**dict(quick), "scenes": rows // 16, "name": f"copies-{rows}"})
    run = [run_row(quick, k) for k in range(16)]

    def copied(_: object, number: int, program: object) -> RowResult:
        row = replace(run[number % 16].row, row=number, scene=number // 8, study_hash=study.hash)
        return replace(run[number % 16], row=row)

    with tempfile.TemporaryDirectory() as made:
        folder = Path(made)
        (folder / "parts").mkdir()
        (folder / HEADER).write_text(StudyHeader(study, PACKAGE.version, ()).to_json())
        work = PartWork(study.to_json(), PACKAGE)
        with patch("omniservo.studies.study_parts.run_row", copied):
            for number in range(part_count(study)):
                write_part(folder, number, work.content(number))
        before, begin = _peak(), perf_counter()
        tally = StudyTally()
        table = write_rows(
            folder, (tally.add(row) or row for part in read_parts(folder) for row in part.rows)
        )
        write_study_report(read_header(folder), tally, folder / "report.html", PACKAGE)
        both = ((row for part in read_parts(folder) for row in part.rows) for _ in range(2))
        compare_studies(*both)
        print(
            f"{study.rows:>8} rows: peak {before:.0f} MB when the parts are written, {_peak():.0f} MB after "
            f"table ({table.stat().st_size / 1e6:.1f} MB), report and comparison, which took "
            f"{perf_counter() - begin:.0f} s"
        )


def _peak() -> float:
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024


if __name__ == "__main__":
    main()
