"""The folder of a study: its header, its lock, and its parts."""

from __future__ import annotations

import fcntl
import importlib.metadata
import json
import platform
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from omniservo.errors import InputError, NotWritten, spelled
from omniservo.files import made_folder, read_document, write_whole
from omniservo.run_methods import METHODS
from omniservo.studies.load_study import study_of_fields
from omniservo.studies.study import Study
from omniservo.tasks.task_files import TaskFiles

FORMAT = "omniservo.study-run/1"
HEADER = "study.json"
_LOCK = ".lock"
"""what is left alone of a study that ended before its header was written"""
_LONGEST_NAME = 200
_LIBRARIES = ("numpy", "scipy", "numba")


@dataclass(frozen=True, eq=False)
class StudyHeader:
    """What all rows of a folder have in common."""

    study: Study
    version: str
    machines: tuple[dict[str, str], ...]
    """that rows were run on: processor, Python and libraries"""

    def to_json(self) -> str:
        """Return the header's file."""
        fields = {
            "format": FORMAT,
            "study_hash": self.study.hash,
            "version": self.version,
            "machines": self.machines,
            "own_methods": [name for name in self.study.methods if name not in METHODS],
            "study": json.loads(self.study.to_json()),
        }
        return json.dumps(fields, indent=1) + "\n"


def _is_own(name: Any) -> bool:
    return isinstance(name, str) and len(name) <= _LONGEST_NAME and name.rpartition(".")[2].isidentifier()


def _is_machine(given: Any) -> bool:
    return isinstance(given, dict) and all(isinstance(value, str) for value in given.values())


def this_machine() -> dict[str, str]:
    """Return processor, Python and libraries: what the last digits of a row depend on."""
    libraries = {name: importlib.metadata.version(name) for name in _LIBRARIES}
    return {"cpu": _processor(), "python": platform.python_version(), **libraries}


def _processor() -> str:
    try:
        lines = Path("/proc/cpuinfo").read_text(encoding="utf-8", errors="replace").splitlines()
    except OSError:
        lines = []
    named = (line.partition(":")[2].strip() for line in lines if line.startswith("model name"))
    return next(named, platform.processor() or platform.machine())


def read_header(folder: Path) -> StudyHeader:
    """Return the header of a study's folder.

    Raises:
        InputError: there is none, or it is not one.
    """
    path = folder / HEADER
    if not path.is_file():
        raise InputError(f"{folder}: not a study's folder: {HEADER} is missing")
    fields: Any = read_document(path)
    if not isinstance(fields, dict) or fields.get("format") != FORMAT:
        raise InputError(f"{path}: format: legal: {FORMAT!r}")
    own = fields.get("own_methods", [])
    if not isinstance(own, list) or not all(map(_is_own, own)):
        raise InputError(f"{path}: own_methods: {spelled(own)}; legal: a list of names FILE.CLASS")
    study = study_of_fields(fields.get("study"), TaskFiles(f"{path}: study", folder), own)
    version, machines = fields.get("version"), fields.get("machines")
    if fields.get("study_hash") != study.hash:
        given = spelled(fields.get("study_hash"))
        raise InputError(f"{path}: study_hash: {given}; its study has {study.hash!r}")
    if not isinstance(version, str) or not isinstance(machines, list) or not all(map(_is_machine, machines)):
        raise InputError(f"{path}: version and machines are needed: texts, and a list of texts by name")
    return StudyHeader(study, version, tuple(machines))


@contextmanager
def opened_folder(study: Study, version: str, folder: Path) -> Iterator[None]:
    """Lock a new folder, or one that holds rows of the same study and version, and write its header.

    Raises:
        InputError: it holds something else, another process works in it, or it cannot be written.
    """
    with made_folder(folder), _locked(folder):
        machines: tuple[dict[str, str], ...] = ()
        if (folder / HEADER).exists():
            there = read_header(folder)
            refuse_other(folder, there, study, version)
            machines = there.machines
        write_whole(folder / HEADER, StudyHeader(study, version, machines).to_json(), force=True)
        yield


@contextmanager
def _locked(folder: Path) -> Iterator[None]:
    """Hold the folder's lock; its file goes again where no header was written beside it.

    Raises:
        InputError: the folder holds something else than a study, another process works in it, or it cannot
            be written.
    """
    file, header = folder / _LOCK, folder / HEADER
    try:
        if not header.exists() and any(path.name != _LOCK for path in folder.iterdir()):
            raise InputError(f"{folder}: exists, and is not a study's folder")
        lock = file.open("w")
    except OSError as error:
        raise NotWritten(folder, error.strerror or str(error)) from None
    with lock:
        try:
            fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            raise InputError(f"{folder}: another process works in it") from None
        try:
            yield
        finally:
            if not header.exists():
                file.unlink(missing_ok=True)


def note_machine(folder: Path, machine: dict[str, str]) -> None:
    """Name a machine in the header of an open folder, if it is not there yet."""
    header = read_header(folder)
    if machine not in header.machines:
        header = replace(header, machines=(*header.machines, machine))
        write_whole(folder / HEADER, header.to_json(), force=True)


def refuse_other(folder: Path, there: StudyHeader, study: Study, version: str) -> None:
    """Refuse a folder of another study or version.

    Raises:
        InputError: it is of another.
    """
    if there.study.hash != study.hash:
        raise InputError(
            f"{folder}: holds rows of the study {there.study.name} {there.study.hash}; "
            f"{study.name} {study.hash} is another"
        )
    if there.version != version:
        raise InputError(f"{folder}: holds rows of version {there.version}; {version} is another")
