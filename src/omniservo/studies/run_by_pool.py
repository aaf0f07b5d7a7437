"""Running parts in processes of this machine."""

from __future__ import annotations

import multiprocessing
import os
import signal
import threading
from collections.abc import Callable, Iterator
from concurrent.futures import FIRST_COMPLETED, Future, ProcessPoolExecutor, wait
from concurrent.futures.process import BrokenProcessPool
from contextlib import contextmanager
from pathlib import Path

from omniservo.errors import NoSolutionError
from omniservo.studies.study_parts import PartWork, write_part

THREADS = ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS")
"""Each worker has one thread: then a row is the same to the last bit however many run beside it.

Numba's number is not among them: its settings belong to compiled kernels, and no kernel of a row has
several."""


def run_by_pool(
    work: PartWork, folder: Path, missing: list[int], workers: int, done: Callable[[int], object]
) -> None:
    """Run parts in processes of their own, few of them ahead: what is queued is lost to an interrupt.

    Raises:
        NotWritten: as `write_part`.
        NoSolutionError: a process was killed; what was finished is there.
    """
    waiting = iter(missing)
    running: dict[Future[None], int] = {}
    begun: tuple[int, ...] = ()
    before = set(multiprocessing.active_children())
    pool = ProcessPoolExecutor(workers, multiprocessing.get_context("spawn"), _begin_worker)
    try:
        with _for_workers():
            for number in (next(waiting) for _ in range(workers)):
                running[pool.submit(_run_part, work, folder, number)] = number
        while running:
            begun = tuple(running.values())
            ended, _ = wait(running, return_when=FIRST_COMPLETED)
            for future in ended:
                number = running.pop(future)
                future.result()
                done(number)
                if (following := next(waiting, None)) is not None:
                    running[pool.submit(_run_part, work, folder, following)] = following
        pool.shutdown()
    except BaseException as error:
        pool.shutdown(wait=False, cancel_futures=True)
        for process in set(multiprocessing.active_children()) - before:
            process.terminate()
        if isinstance(error, BrokenProcessPool):
            rows = ", ".join(f"{work.rows(number)[0]} to {work.rows(number)[-1]}" for number in begun)
            raise NoSolutionError(
                f"{folder}: a worker process was killed while rows {rows} were run; finished parts are kept, "
                "the same command goes on. Where it is killed again, run --replay FOLDER:ROW runs one alone"
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


def _run_part(work: PartWork, folder: Path, number: int) -> None:
    write_part(folder, number, work.content(number))
