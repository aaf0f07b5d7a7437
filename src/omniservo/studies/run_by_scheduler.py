"""Running parts on a Dask cluster: on one machine or many, by the address of its scheduler."""

from __future__ import annotations

import logging
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from itertools import islice
from pathlib import Path
from typing import Any

from omniservo.errors import InputError, NoSolutionError, spelled
from omniservo.studies.load_study import study_of_json
from omniservo.studies.study_folder import note_machine, this_machine
from omniservo.studies.study_parts import PartWork, part_file, part_of_content, write_part

_PATIENCE = 30.0
"""[s] until a scheduler answers"""
_AHEAD = 4
"""parts that are handed out for every thread of the cluster; it may grow and shrink"""
_LEAST_AHEAD = 64


def run_by_scheduler(
    work: PartWork,
    folder: Path,
    missing: list[int],
    address: str,
    done: Callable[[int], object],
    waiting: Callable[[str], object],
) -> None:
    """Run parts on the cluster of a scheduler, and write each here as it comes.

    Where the cluster has no worker yet, ``waiting`` is called, and one is waited for: a queue may start it
    hours later. A part whose worker is killed is run again by another. What comes is checked before it is
    written: it is whole, of this study, and of this version of the program.

    Raises:
        InputError: Dask is not installed, no scheduler answers there, or a worker has another version.
        NotWritten: as `write_part`.
        NoSolutionError: the scheduler ended, a worker cannot run parts, or several were killed while they ran
            one; what was finished is there.
    """
    client, as_completed = _connected(address)
    study, version = study_of_json(work.study, work.program.names), work.program.version
    left = iter(missing)
    noted: list[dict[str, str]] = []

    def handed_out(count: int) -> list[Any]:
        key = study.hash, version
        return [client.submit(_run_part, work, n, key=(*key, n), pure=False) for n in islice(left, count)]

    with _without_tracebacks(), client:
        if not client.nthreads():
            waiting(f"waiting for a worker of {address}")
            client.wait_for_workers(1)
        ahead = max(_LEAST_AHEAD, _AHEAD * sum(client.nthreads().values()))
        running = as_completed(handed_out(ahead), loop=client.loop)
        for future in running:
            number, content, machine = _result(future, folder)
            part_of_content(study, version, part_file(folder, number), number, content)
            write_part(folder, number, content)
            if machine not in noted:
                note_machine(folder, machine)
                noted.append(machine)
            future.release()  # else the cluster would keep what is written here
            running.update(handed_out(1))
            done(number)


def _run_part(work: PartWork, number: int) -> tuple[int, bytes, dict[str, str]]:
    """Run on a worker: return a part's number, content and machine."""
    return number, work.content(number), this_machine()


def _result(future: Any, folder: Path) -> Any:
    try:
        return future.result()
    except Exception as error:  # of Dask, such as KilledWorker, or of what the worker has in place of ours
        said = " ".join(str(error).split())[:300]
        raise NoSolutionError(
            f"{folder}: the cluster gives no rows: {type(error).__name__}: {said}; finished parts are kept, "
            "the same command goes on"
        ) from None


@contextmanager
def _without_tracebacks() -> Iterator[None]:
    """Let the client not log what `_result` says of a cluster that is lost."""
    log = logging.getLogger("distributed.client")
    level = log.level
    log.setLevel(logging.CRITICAL)
    try:
        yield
    finally:
        log.setLevel(level)


def _connected(address: str) -> tuple[Any, Any]:
    """Return a client of the scheduler, and what yields its results as they come."""
    try:
        from distributed import Client, as_completed
        from distributed.comm import get_address_host_port
    except ImportError:
        raise InputError("scheduler: Dask is not installed; needed: pip install omniservo[cluster]") from None
    try:
        get_address_host_port(address)  # a client of what is no address ends in a traceback, after a minute
        return Client(address, timeout=_PATIENCE, set_as_default=False), as_completed
    except (OSError, ValueError) as error:
        raise InputError(f"scheduler: {spelled(address)}: no scheduler answers there ({error})") from None
