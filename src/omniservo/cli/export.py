"""``omniservo export``."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Literal

import typer

from omniservo.cli.grouped import grouped
from omniservo.cli.output import ForceOption, Output
from omniservo.errors import InputError
from omniservo.files import writable


@grouped
def export(
    run: Annotated[Path, typer.Argument(help="Folder that omniservo run has left.")],
    *,
    to: Annotated[Literal["mcap"], typer.Option("--to", help="Format; ROS 2 messages in MCAP.")] = "mcap",
    out: Annotated[
        Path | None, typer.Option("--out", help="The file; default: the folder's name with .mcap, beside it.")
    ] = None,
    force: ForceOption = False,
    output: Output,
) -> None:
    """Write a finished run as a file that Foxglove and ROS 2 tools open.

    A simulated run is done again for it, with the same seed, and must come to the same log.
    """
    if not run.is_dir():
        raise InputError(f"{run}: not a folder")
    place = run.resolve()
    file = place.parent / f"{place.name}.{to}" if out is None else out
    writable(file, force=force)
    with output.working("starting") as progress:
        progress("loading")
        from omniservo.runs import export_run
        from omniservo.runs.compile_ahead import compiling_ahead
        from omniservo.simulation import SimulatedCell

        with compiling_ahead():
            made = export_run(run, file, SimulatedCell, force=force, progress=progress)
    if made.repeated:
        output.line("done again as it was: the log is the same")
    output.written(file, f" ({made.bytes / 1e6:.1f} MB)")
    output.result({"out": str(file), "repeated": made.repeated, "bytes": made.bytes}, "export")
