"""All rows of a study: read from its parts, and written for others as Parquet or CSV."""

from __future__ import annotations

import csv
import io
from collections.abc import Callable, Iterator
from dataclasses import fields
from pathlib import Path
from typing import Any

from omniservo.errors import InputError
from omniservo.files import write_whole
from omniservo.studies.study_folder import read_header
from omniservo.studies.study_parts import StudyPart, part_count, part_file, read_part
from omniservo.studies.study_row import COLUMNS, StudyRow, fields_of_row

PARQUET, CSV = "rows.parquet", "rows.csv"
_SHOWN = 5


def read_parts(
    folder: Path, progress: Callable[[str, float], object] = lambda stage, share: None
) -> Iterator[StudyPart]:
    """Yield every part of a complete study, in order.

    Raises:
        InputError: it is not complete, or a part is damaged or of another study or version.
    """
    study = read_header(folder).study
    count = part_count(study)
    missing = [number for number in range(count) if not part_file(folder, number).exists()]
    if missing:
        named = ", ".join(part_file(folder, number).name for number in missing[:_SHOWN])
        more = ", …" if len(missing) > _SHOWN else ""
        which = f"{len(missing)} of {count} parts are missing: {named}{more}"
        raise InputError(f"{folder}: {which}; run the study into it again")
    for number in range(count):
        yield read_part(study, folder, number)
        progress("reading rows", (number + 1) / count)


def write_rows(folder: Path, rows: list[StudyRow]) -> Path:
    """Write the table, as Parquet where pyarrow is installed, else as CSV; return its path."""
    try:
        import pyarrow  # noqa: F401
    except ImportError:
        path = folder / CSV
        write_whole(path, _csv(rows), force=True)
        return path
    path = folder / PARQUET
    write_whole(path, _parquet(rows), force=True)
    return path


def _csv(rows: list[StudyRow]) -> str:
    stream = io.StringIO()
    table = csv.writer(stream, lineterminator="\n")
    table.writerow(COLUMNS)
    table.writerows(fields_of_row(row).values() for row in rows)
    return stream.getvalue()


def _parquet(rows: list[StudyRow]) -> bytes:
    import pyarrow as pa
    from pyarrow import parquet

    kinds = {"int": pa.int64(), "str": pa.string(), "bool": pa.bool_(), "float | None": pa.float64()}
    schema = pa.schema([(field.name, kinds[str(field.type)]) for field in fields(StudyRow)])
    columns: dict[str, list[Any]] = {name: [getattr(row, name) for row in rows] for name in COLUMNS}
    stream = io.BytesIO()
    parquet.write_table(pa.table(columns, schema=schema), stream, compression="zstd")
    return stream.getvalue()
