"""Parts of a study: rows that were run together, written whole under their number, never written again."""

from __future__ import annotations

import errno
import gzip
import hashlib
import io
import json
import os
import zlib
from collections import defaultdict
from collections.abc import Iterable
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path
from time import process_time
from typing import Any

from omniservo.errors import InputError, NotWritten
from omniservo.files import read_bytes
from omniservo.studies.load_study import study_of_json
from omniservo.studies.program import Program
from omniservo.studies.study import Study
from omniservo.studies.study_row import RowResult, StudyRow, fields_of_row, row_of_fields, run_row

FORMAT = "omniservo.study-part/2"
_FOLDER = "parts"
_ENDING = ".jsonl.gz"
_NO_LINKS = (errno.EPERM, errno.ENOTSUP, errno.ENOSYS)
"""what file systems without hard links answer; parts are renamed there"""
_MOST_TEXT = 2**27
"""[bytes] of a part's text that are read"""
_MOST_ROWS, _LEAST_ROWS, _PARTS = 100, 8, 16
"""Rows of a part: some 10 s of work, as a worker takes 5 to 10 s to start; small studies have 16 parts."""


@dataclass(frozen=True)
class StudyPart:
    """A part that was read: its rows, the plan of each certified one, and what it took."""

    number: int
    rows: tuple[StudyRow, ...]
    plans: dict[int, dict[str, Any]]
    """row → plan file"""
    cpu_seconds: dict[str, float]
    """method → of all its rows"""


@dataclass(frozen=True)
class PartWork:
    """What a process is handed that runs parts."""

    study: str
    """as `Study.to_json` has it"""
    program: Program

    def content(self, number: int) -> bytes:
        """Run a part's rows; return what its file holds."""
        return part_content(_study(self.study, self.program.names), self.program, number)

    def rows(self, number: int) -> range:
        """Return the numbers of a part's rows."""
        return rows_of_part(_study(self.study, self.program.names), number)


_study = lru_cache(maxsize=1)(study_of_json)


def part_rows(study: Study) -> int:
    """Return how many rows a part has: by the study alone, so that parts fit whoever ran them."""
    few = -(-study.rows // _PARTS)
    rows = min(_MOST_ROWS, max(_LEAST_ROWS, few))
    return -(-rows // len(study.methods)) * len(study.methods)


def part_count(study: Study) -> int:
    """Return how many parts a study has."""
    return -(-study.rows // part_rows(study))


def rows_of_part(study: Study, number: int) -> range:
    """Return the numbers of a part's rows."""
    size = part_rows(study)
    return range(number * size, min((number + 1) * size, study.rows))


def part_file(folder: Path, number: int) -> Path:
    """Return where a part is."""
    return folder / _FOLDER / f"{number:06d}{_ENDING}"


def missing_parts(study: Study, folder: Path, wanted: Iterable[int]) -> list[int]:
    """Return which of the wanted parts are not there, and clear away what was left half-written."""
    parts = folder / _FOLDER
    parts.mkdir(exist_ok=True)
    for left in parts.glob(".*"):
        left.unlink(missing_ok=True)
    there = {entry.name for entry in os.scandir(parts)}
    return [number for number in wanted if part_file(folder, number).name not in there]


def part_content(study: Study, program: Program, number: int) -> bytes:
    """Run a part's rows; return what its file holds."""
    results: list[RowResult] = []
    taken: dict[str, float] = defaultdict(float)
    for row in rows_of_part(study, number):
        begin = process_time()
        results.append(run_row(study, row, program))
        taken[results[-1].row.method] += process_time() - begin
    lines = [_line({"format": FORMAT, "part": number, **_identity(study, program.version)})]
    for result in results:
        plan = result.plan_fields()
        lines.append(_line({"row": fields_of_row(result.row), **({} if plan is None else {"plan": plan})}))
    text = "".join(lines)
    seconds = {method: round(value, 3) for method, value in taken.items()}
    end = _line({"digest": _digest(text), "cpu_seconds": seconds})
    return gzip.compress((text + end).encode(), 5, mtime=0)


def write_part(folder: Path, number: int, content: bytes) -> None:
    """Write a part whole under a hidden name, then link it to its own; the first one there stays.

    Raises:
        NotWritten: the disk is full, or the folder is not ours. Nothing of the part is left.
    """
    path = part_file(folder, number)
    hidden = path.with_name(f".{path.name}.{os.getpid()}")
    try:
        with hidden.open("xb") as stream:
            stream.write(content)
            stream.flush()
            os.fsync(stream.fileno())
        try:
            os.link(hidden, path)
        except FileExistsError:
            return
        except OSError as error:
            if error.errno not in _NO_LINKS:
                raise
            hidden.replace(path)
    except OSError as error:
        raise NotWritten(path, error.strerror or str(error)) from None
    finally:
        hidden.unlink(missing_ok=True)


def read_part(study: Study, version: str, folder: Path, number: int) -> StudyPart:
    """Return a part as it was written.

    Raises:
        InputError: missing, damaged, or of another study or version; the message names the file.
    """
    path = part_file(folder, number)
    return part_of_content(study, version, path, number, read_bytes(path, max_bytes=_MOST_TEXT))


def part_of_content(study: Study, version: str, path: Path, number: int, content: bytes) -> StudyPart:
    """Return the part that a file's content has; ``path`` stands in messages.

    Raises:
        InputError: as `read_part`.
    """
    lines = _text(path, content).splitlines(keepends=True)
    try:
        head, *rows, end = (json.loads(line) for line in lines)
        if end["digest"] != _digest("".join(lines[:-1])):
            raise _damaged(path, "its digest does not fit")
        for name, value in {"format": FORMAT, "part": number, **_identity(study, version)}.items():
            if head.get(name) != value:
                raise InputError(f"{path}: {name}: {head.get(name)!r}; {value!r} is needed")
        found = tuple(row_of_fields(entry["row"]) for entry in rows)
        taken = {method: float(end["cpu_seconds"].get(method, 0.0)) for method in study.methods}
    except InputError:
        raise
    except (ValueError, KeyError, TypeError, AttributeError, RecursionError) as error:
        raise _damaged(path, f"not a part ({type(error).__name__})") from None
    if [_place(row) for row in found] != [_expected(study, version, k) for k in rows_of_part(study, number)]:
        raise _damaged(path, "not the rows of this part")
    plans = {entry["row"]["row"]: entry["plan"] for entry in rows if "plan" in entry}
    return StudyPart(number, found, plans, taken)


def _place(row: StudyRow) -> tuple[Any, ...]:
    return row.row, row.study_hash, row.version, row.seed, row.scene, row.camera, row.method


def _expected(study: Study, version: str, row: int) -> tuple[Any, ...]:
    return row, study.hash, version, study.seed, *study.place(row)


def _text(path: Path, content: bytes) -> str:
    try:
        with gzip.GzipFile(fileobj=io.BytesIO(content)) as stream:
            text = stream.read(_MOST_TEXT + 1)
        if len(text) > _MOST_TEXT:
            raise _damaged(path, f"more than {_MOST_TEXT} bytes of text")
        return text.decode()
    except (OSError, EOFError, zlib.error, UnicodeDecodeError) as error:
        raise _damaged(path, str(error)) from None


def _damaged(path: Path, why: str) -> InputError:
    return InputError(f"{path}: damaged: {why}; delete it and run the study into this folder again")


def _identity(study: Study, version: str) -> dict[str, str]:
    return {"study_hash": study.hash, "version": version}


def _digest(text: str) -> str:
    return hashlib.sha256(text.encode()).hexdigest()


def _line(value: dict[str, Any]) -> str:
    return json.dumps(value, allow_nan=False) + "\n"
