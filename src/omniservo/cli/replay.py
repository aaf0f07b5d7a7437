"""``omniservo run --replay``."""

from __future__ import annotations

from pathlib import Path

import typer

from omniservo.cli.output import Output, answer_is_no
from omniservo.errors import InputError
from omniservo.files import require_file

_ALLOWED = ("replay", "allow_outside", "as_json", "quiet")


def refuse_other_options(context: typer.Context, *allowed: str) -> None:
    """Refuse what the recording, or the study, itself says; ``allowed`` are options that it does not.

    Raises:
        InputError: an option or a task beside --replay.
    """
    for parameter in context.command.params:
        name = str(parameter.name)
        if name not in (*_ALLOWED, *allowed) and is_given(context, name):
            given = parameter.opts[0] if parameter.param_type_name == "option" else "TASK"
            raise InputError(f"{given}: given with --replay, which takes all of it from the recording")


def is_given(context: typer.Context, name: str) -> bool:
    """Return whether a parameter stands in the call."""
    source = context.get_parameter_source(name)
    return source is not None and source.name == "COMMANDLINE"


def replay(file: Path, allow_outside: bool, output: Output) -> None:
    """Replay a recording and say whether it came to the same.

    Raises:
        InputError: no recording; of a folder it is said what of it can be replayed.
    """
    if file.is_dir():
        raise InputError(f"--replay: {file}: a folder; legal: {_in_place_of(file)}")
    require_file(file)
    with output.working("starting") as progress:
        progress("loading")
        from omniservo.runs import replay_run

        found = replay_run(file, allow_outside=allow_outside, progress=progress)
    equal = not found.differences
    exact = "bit by bit" if not found.largest else f"within {found.largest:.1g}"
    output.line(f"{found.task}, recorded by version {found.version}: {found.steps} steps replayed")
    if found.dropped:
        output.line(f"{found.dropped} images are missing, as it says: {found.left} steps were not replayed")
    if found.cut:
        output.line("the file is cut off: what is before was replayed")
    elif found.ended:
        output.line(f"as recorded the run ended with {found.ended}")
    if equal:
        output.line(f"equal to what was logged, {exact}")
    for difference in found.differences:
        output.line(f"differs: {difference}")
    output.result(
        {
            "status": "equal" if equal else "differs",
            "task": found.task,
            "version": found.version,
            "steps": found.steps,
            "largest_difference": found.largest,
            "differences": found.differences,
            "images_missing": found.dropped,
            "steps_left": found.left,
            "cut": found.cut,
            "ended": found.ended,
        },
        "run-replay",
    )
    if not equal:
        raise answer_is_no(f"differs from what was logged: {found.differences[0]}")


def _in_place_of(folder: Path) -> str:
    """Return what can be replayed where a folder was given."""
    from omniservo.runs.export_run import RECORDING

    recording = folder / RECORDING
    if recording.exists():
        return f"the recording in it, {recording}"
    if (folder / "study.json").exists():
        return f"one of the study's rows, {folder}:ROW"
    if (folder / "metrics.json").exists():
        return f"a recording, which omniservo export {folder} makes of the run"
    return "a recording (.mcap), or STUDY:ROW"
