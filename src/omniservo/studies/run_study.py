"""Running a study's parts: on all cores, resumed where it was ended, or one shard of it."""

from __future__ import annotations

import multiprocessing
import os
import signal
import threading
from collections.abc import Callable, Iterator
from concurrent.futures import FIRST_COMPLETED, Future, ProcessPoolExecutor, wait
from concurrent.futures.process import BrokenProcessPool
from contextlib import contextmanager
from dataclasses import dataclass
from functools import cache
from pathlib import Path

from omniservo.errors import InputError, NoSolutionError
from omniservo.studies.load_study import study_of_json
from omniservo.studies.study import Study
from omniservo.studies.study_folder import opened_folder
from omniservo.studies.study_parts import missing_parts, part_count, rows_of_part, run_part

Progress = Callable[[str, float], object]
"""Called with what is being done, and the share of it that is behind."""

THREADS = ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS")
"""Each worker has one thread: then a row is the same to the last bit however many run beside it.

Numba's number is not among them: its settings belong to compiled kernels, and no kernel of a row has
several."""


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
    workers: int | None = None,
    shard: Shard | None = None,
    progress: Progress = lambda stage, share: None,
) -> bool:
    """Run the parts that are not in the folder yet; return whether it holds the whole study then.

    Args:
        study: what is run.
        folder: new, or of the same study and version.
        workers: processes; None: one for each core. One: this process itself.
        shard: the share to run; None: all.
        progress: is called with what is behind.

    Raises:
        InputError: the folder is another study's, in use, or cannot be written.
        NoSolutionError: a worker process was killed; what was finished is there.
    """
    share = shard or Shard()
    count = workers if workers is not None else _cores()
    if count < 1:
        raise InputError(f"workers: {count} given; legal: 1 or more")
    with opened_folder(study, folder):
        wanted = range(share.number - 1, part_count(study), share.count)
        missing = missing_parts(study, folder, wanted)
        behind = _Behind(study, len(wanted) - len(missing), missing, progress)
        if count == 1 or len(missing) == 1:
            for number in missing:
                run_part(study, folder, number)
                behind.add(number)
        elif missing:
            _run_by_pool(study, folder, missing, min(count, len(missing)), behind)
        return not missing_parts(study, folder, range(part_count(study)))


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


def _run_by_pool(study: Study, folder: Path, missing: list[int], workers: int, behind: _Behind) -> None:
    """Run parts in processes of their own, few of them ahead: what is queued is lost to an interrupt."""
    text, waiting = study.to_json(), iter(missing)
    running: dict[Future[None], int] = {}
    before = set(multiprocessing.active_children())
    pool = ProcessPoolExecutor(workers, multiprocessing.get_context("spawn"), _begin_worker)
    try:
        with _for_workers():
            for number in (next(waiting) for _ in range(workers)):
                running[pool.submit(_run_part, text, str(folder), number)] = number
        while running:
            done, _ = wait(running, return_when=FIRST_COMPLETED)
            for future in done:
                number = running.pop(future)
                future.result()
                behind.add(number)
                if (following := next(waiting, None)) is not None:
                    running[pool.submit(_run_part, text, str(folder), following)] = following
        pool.shutdown()
    except BaseException as error:
        pool.shutdown(wait=False, cancel_futures=True)
        for process in set(multiprocessing.active_children()) - before:
            process.terminate()
        if isinstance(error, BrokenProcessPool):
            raise NoSolutionError(
                f"{folder}: a worker process was killed; finished parts are kept, the same command goes on"
            ) from None
        raise


@contextmanager
def _for_workers() -> Iterator[None]:
    """Let processes started here have one thread each, and leave Ctrl-C to this one."""
    kept = {name: os.environ.get(name) for name in THREADS}
    os.environ.update(dict.fromkeys(THREADS, "1"))
    ours = threading.current_thread() is threading.main_thread()
    answer = signal.signal(signal.SIGINT, signal.SIG_IGN) if ours else None
    try:
        yield
    finally:
        if ours:
            signal.signal(signal.SIGINT, answer)
        for name, value in kept.items():
            if value is None:
                del os.environ[name]
            else:
                os.environ[name] = value


def _begin_worker() -> None:
    """End with the process that started this one: else a killed study would leave its workers waiting."""
    parent = multiprocessing.parent_process()

    def watch() -> None:
        if parent is not None:
            parent.join()
            os._exit(1)

    threading.Thread(target=watch, daemon=True).start()


_study = cache(study_of_json)


def _run_part(text: str, folder: str, number: int) -> None:
    run_part(_study(text), Path(folder), number)
