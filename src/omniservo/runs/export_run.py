"""A finished run as a recording: the one that it has, or that of the same run once more."""

from __future__ import annotations

import csv
import io
import tempfile
from dataclasses import dataclass
from pathlib import Path

from omniservo.errors import InputError, NoSolutionError
from omniservo.field_docs import with_field_docs
from omniservo.files import copy_whole, read_text, writable
from omniservo.recording import RecordedRun, RunRecording
from omniservo.results import RunLog
from omniservo.runs.comparison import Comparison
from omniservo.runs.job_progress import JobProgress, Progress
from omniservo.runs.robot_cell import OpenCell
from omniservo.runs.run_inputs import RunInputs
from omniservo.runs.run_task import run_task
from omniservo.tasks import TaughtGoal

RECORDING = "recording.mcap"
"""The recording in the folder of a run that has one."""

_MOST_LOG = 2**28
_TIMES = "control_seconds"


@with_field_docs
@dataclass(frozen=True)
class Exported:
    """What was written."""

    repeated: bool
    """the run was done once more, in the simulator; else its own recording was copied"""
    bytes: int
    """of the file"""


def export_run(
    run: Path,
    out: Path,
    open_cell: OpenCell,
    *,
    force: bool = False,
    progress: Progress = lambda stage, done: None,
) -> Exported:
    """Write the recording of a finished run to ``out``.

    A simulated run keeps no image of every step: it would be 5 MB a second. It is done again from what its
    folder says, which takes as long as without its film, and must come to the same log.

    Args:
        run: folder of results.
        out: the file.
        open_cell: the simulator's.
        force: an existing file is replaced.
        progress: called with what is being done.

    Raises:
        InputError: no folder of a run; the file exists and ``force`` is False.
        NoSolutionError: done again it came out otherwise, as another version may; nothing is written.
    """
    writable(out, force=force)
    own = run / RECORDING
    if own.is_file():
        for _ in RecordedRun(own):  # refuses what is damaged
            pass
        copy_whole(own, out, force=force)
        return Exported(False, out.stat().st_size)
    inputs = RunInputs.read(run)
    goal = TaughtGoal.load(run / "goal.json")
    with tempfile.TemporaryDirectory(prefix="omniservo-") as folder:
        inputs.task.write(Path(folder))
        task = inputs.task.load(Path(folder), goal.camera, allow_outside=True)
        job = JobProgress(progress, (inputs.method,), filmed=False)
        job.begin_run(0)
        recording = RunRecording(out, force=force)
        try:
            result = run_task(
                task, open_cell, method=inputs.method, goal=goal, seed=inputs.seed, filmed=False,
                progress=job, recording=recording,
            )  # fmt: skip
            if off := _other_than(result.log, run / "log.csv"):
                raise NoSolutionError(
                    f"{run}: done again it is another run: {off}; recorded by {inputs.version}"
                )
        except BaseException:
            recording.discard()
            raise
        recording.close()
    return Exported(True, out.stat().st_size)


def _other_than(log: RunLog, file: Path) -> str:
    """Return where a log differs from the one that is kept; nothing where it does not."""
    then = list(csv.reader(io.StringIO(read_text(file, max_bytes=_MOST_LOG))))
    now = list(csv.reader(io.StringIO(log.to_csv())))
    if then[:1] != now[:1] or len(then) != len(now):
        return f"{max(len(then) - 1, 0)} steps in log.csv, {max(len(now) - 1, 0)} now"
    found = Comparison()
    for number, (before, after) in enumerate(zip(then[1:], now[1:], strict=True), start=1):
        for name, old, new in zip(then[0], before, after, strict=False):
            if name != _TIMES and old != new:
                found.numbers(name, f"step {number}: ", _number(old, file), _number(new, file))
    return "; ".join(found.differences[:3])


def _number(text: str, file: Path) -> float:
    try:
        return float(text)
    except ValueError:
        raise InputError(f"{file}: {text[:40]!r} is no number") from None
