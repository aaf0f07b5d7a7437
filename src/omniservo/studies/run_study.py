"""Running a study's parts: on all cores or a cluster, resumed where it was ended, or one shard of it."""

from __future__ import annotations

import os
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

from omniservo.errors import InputError
from omniservo.studies.program import PACKAGE, Program
from omniservo.studies.run_by_pool import run_by_pool
from omniservo.studies.run_by_scheduler import run_by_scheduler
from omniservo.studies.study import Study
from omniservo.studies.study_folder import note_machine, opened_folder, this_machine
from omniservo.studies.study_parts import PartWork, missing_parts, part_count, rows_of_part, write_part

Progress = Callable[[str, float], object]
"""Called with what is being done, and the share of it that is behind."""


@dataclass(frozen=True)
class Shard:
    """One of ``count`` equal shares of a study's parts: every count-th, from ``number`` − 1 on."""

    number: int = 1
    count: int = 1

    def __post_init__(self) -> None:
        if not 1 <= self.number <= self.count <= 100_000:
            raise InputError(f"shard: {self.number}/{self.count} given; legal: k/n with 1 ≤ k ≤ n ≤ 100000")

    @classmethod
    def parse(cls, text: str) -> Shard:
        """Return the shard that ``k/n`` says.

        Raises:
            InputError: it is not of this form.
        """
        number, slash, count = text.partition("/")
        if not (slash and number.isascii() and number.isdigit() and count.isascii() and count.isdigit()):
            raise InputError(f"shard: {text[:40]!r} given; legal: k/n, such as 1/4")
        return cls(int(number[:9]), int(count[:9]))


def run_study(
    study: Study,
    folder: Path,
    *,
    program: Program = PACKAGE,
    workers: int | None = None,
    scheduler: str | None = None,
    shard: Shard | None = None,
    progress: Progress = lambda stage, share: None,
) -> bool:
    """Run the parts that are not in the folder yet; return whether it holds the whole study then.

    Args:
        study: what is run.
        folder: new, or of the same study and version.
        program: this package, and methods from files that the study names.
        workers: processes; None: one for each core. One: this process itself.
        scheduler: address of a Dask cluster that runs the parts in place of this machine.
        shard: the share to run; None: all.
        progress: is called with what is behind.

    Raises:
        InputError: the study names a method that the program does not have; both workers and a scheduler; the
            folder is another study's or version's, in use, or cannot be written; no scheduler there, or a
            worker of another version.
        NoSolutionError: a worker was killed, of a cluster more often than its scheduler allows; what was
            finished is there.
    """
    share = shard or Shard()
    count = workers if workers is not None else _cores()
    if count < 1:
        raise InputError(f"workers: {count} given; legal: 1 or more")
    for name in study.methods:
        program.method(name)
    if scheduler is not None and workers is not None:
        raise InputError("workers, scheduler: both given; legal: one of them")
    with opened_folder(study, program.version, folder):
        wanted = range(share.number - 1, part_count(study), share.count)
        missing = missing_parts(study, folder, wanted)
        behind = _Behind(study, len(wanted) - len(missing), missing, progress)
        work = PartWork(study.to_json(), program)
        if scheduler is not None and missing:
            run_by_scheduler(work, folder, missing, scheduler, behind.add, behind.wait)
        elif missing:
            note_machine(folder, this_machine())
            _run_here(work, folder, missing, min(count, len(missing)), behind.add)
        return not missing_parts(study, folder, range(part_count(study)))


def _run_here(
    work: PartWork, folder: Path, missing: list[int], workers: int, done: Callable[[int], object]
) -> None:
    if workers > 1:
        run_by_pool(work, folder, missing, workers, done)
        return
    for number in missing:
        write_part(folder, number, work.content(number))
        done(number)


def _cores() -> int:
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


class _Behind:
    """Says how many rows are behind."""

    def __init__(self, study: Study, there: int, missing: list[int], progress: Progress) -> None:
        self._study, self._progress, self._done = study, progress, 0
        self._rows = sum(len(rows_of_part(study, number)) for number in missing)
        more = f", {there} parts are there" if there else ""
        self._what = f"running {self._rows} rows{more}"
        progress(self._what, 0.0)

    def add(self, number: int) -> None:
        """Count a part."""
        self._done += len(rows_of_part(self._study, number))
        share = self._done / self._rows
        self._progress(f"{self._what}: {int(10 * share) * 10}%", share)

    def wait(self, for_what: str) -> None:
        """Say what is waited for before the first part."""
        self._progress(f"{self._what}: {for_what}", 0.0)
