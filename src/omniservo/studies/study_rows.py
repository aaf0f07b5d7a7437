"""All rows of a study: read from its parts, and written for others as Parquet or CSV."""

from __future__ import annotations

import csv
import os
from collections.abc import Callable, Iterable, Iterator
from dataclasses import fields
from itertools import islice
from pathlib import Path
from typing import Any

from omniservo.errors import InputError, NotWritten
from omniservo.studies.study_folder import read_header
from omniservo.studies.study_parts import StudyPart, part_count, part_file, read_part
from omniservo.studies.study_row import COLUMNS, StudyRow, fields_of_row

PARQUET, CSV = "rows.parquet", "rows.csv"
_SHOWN = 5
_TOGETHER = 4000
"""rows that are written together: a row group of Parquet"""


def read_parts(
    folder: Path, progress: Callable[[str, float], object] = lambda stage, share: None
) -> Iterator[StudyPart]:
    """Yield every part of a complete study, in order.

    Raises:
        InputError: it is not complete, or a part is damaged or of another study or version.
    """
    header = read_header(folder)
    study = header.study
    count = part_count(study)
    missing = [number for number in range(count) if not part_file(folder, number).exists()]
    if missing:
        named = ", ".join(part_file(folder, number).name for number in missing[:_SHOWN])
        more = ", …" if len(missing) > _SHOWN else ""
        which = f"{len(missing)} of {count} parts are missing: {named}{more}"
        raise InputError(f"{folder}: {which}; run the study into it again")
    for number in range(count):
        yield read_part(study, header.version, folder, number)
        progress("reading rows", (number + 1) / count)


def write_rows(folder: Path, rows: Iterable[StudyRow]) -> Path:
    """Write the table, as Parquet where pyarrow is installed, else as CSV; return its path.

    Few rows are held at a time.

    Raises:
        NotWritten: the disk is full, or the folder is not ours.
    """
    try:
        import pyarrow  # noqa: F401
    except ImportError:
        path, write = folder / CSV, _write_csv
    else:
        path, write = folder / PARQUET, _write_parquet
    hidden = path.with_name(f".{path.name}.{os.getpid()}")
    try:
        write(hidden, _batched(rows, _TOGETHER))
        hidden.replace(path)
    except OSError as error:
        raise NotWritten(path, error.strerror or str(error)) from None
    finally:
        hidden.unlink(missing_ok=True)
    return path


def _batched(rows: Iterable[StudyRow], count: int) -> Iterator[list[StudyRow]]:
    """Yield so many rows at a time."""
    waiting = iter(rows)
    while batch := list(islice(waiting, count)):
        yield batch


def _write_csv(path: Path, batches: Iterable[list[StudyRow]]) -> None:
    with path.open("w", encoding="utf-8", newline="") as stream:
        table = csv.writer(stream, lineterminator="\n")
        table.writerow(COLUMNS)
        for rows in batches:
            table.writerows(fields_of_row(row).values() for row in rows)


def _write_parquet(path: Path, batches: Iterable[list[StudyRow]]) -> None:
    import pyarrow as pa
    from pyarrow import parquet

    kinds = {"int": pa.int64(), "str": pa.string(), "bool": pa.bool_(), "float | None": pa.float64()}
    schema = pa.schema([(field.name, kinds[str(field.type)]) for field in fields(StudyRow)])
    with parquet.ParquetWriter(path, schema, compression="zstd") as table:
        for rows in batches:
            columns: dict[str, list[Any]] = {name: [getattr(row, name) for row in rows] for name in COLUMNS}
            table.write_table(pa.table(columns, schema=schema))
