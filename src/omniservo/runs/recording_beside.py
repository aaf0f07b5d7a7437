"""The recording of a run on a real robot: it grows beside the folder of results, and moves into it."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from itertools import count
from pathlib import Path

from omniservo.errors import NotWritten
from omniservo.recording import QueuedRecording
from omniservo.runs.export_run import RECORDING


@contextmanager
def recording_beside(folder: Path, work: Path, left: Callable[[Path], None]) -> Iterator[QueuedRecording]:
    """Give a recording; where the block ends well it is ``recording.mcap`` in ``work``.

    While the block runs, and if this process is killed, it is FOLDER.unfinished.mcap beside the folder;
    where the block ends by an exception it is FOLDER.mcap, or nothing where nothing was recorded. None that
    is there is overwritten.

    Args:
        folder: of results.
        work: becomes that folder.
        left: called with the file that stays beside it.

    Raises:
        NotWritten: it cannot be begun.
    """
    names = (f"{folder.name}-{number}.mcap" for number in count(2))
    path = folder.with_name(f"{folder.name}.mcap")
    while path.exists() or path.with_suffix(".unfinished.mcap").exists():
        path = folder.with_name(next(names))
    recording = QueuedRecording(path)
    try:
        yield recording
    except BaseException:
        if recording.is_empty:
            recording.discard()
            raise
        recording.close()
        left(path if path.exists() else recording.unfinished)
        raise
    recording.close()
    whole = recording.failure is None
    try:
        (path if whole else recording.unfinished).replace(
            work / (RECORDING if whole else "recording.unfinished.mcap")
        )
    except OSError as error:
        raise NotWritten(path, error.strerror or str(error)) from None
