"""``omniservo robot measure-tube``."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from omniservo.cli.completion import task_names
from omniservo.cli.grouped import grouped
from omniservo.cli.output import ForceOption, Output
from omniservo.cli.robot_options import TaskOptions
from omniservo.files import writable


@grouped
def measure_tube(
    task: Annotated[
        str,
        typer.Argument(
            help="A task with the arm and its camera: a file, or a shipped name.", autocompletion=task_names
        ),
    ],
    runs: Annotated[list[Path], typer.Argument(help="Folders of runs, or their log.csv.")],
    *,
    out: Annotated[Path, typer.Option("--out", help="Write the tube here (JSON).")],
    files: TaskOptions,
    force: ForceOption = False,
    output: Output,
) -> None:
    """Measure on an arm's own runs how far it deviates from its plans."""
    writable(out, force=force)
    logs = [path / "log.csv" if path.is_dir() else path for path in runs]
    with output.working("loading") as progress:
        from omniservo.runs.measure_tube import measure_tube as measured

        loaded = files.load(task)
        progress(f"comparing {len(logs)} runs with their plans")
        found = measured(loaded, logs)
    found.save(out, force=force)
    output.line(f"{'arm':<14} {found.arm}, {len(logs)} runs; the next one leaves the tube of all of them")
    share = 1.0 / (found.runs + 1)
    output.line(f"{'':<14} with a probability of {100 * share:.2g}% at most")
    tube = found.at(share)
    output.line(f"{'camera':<14} {1e3 * tube.position:.2f} mm, {tube.image:.2f} px")
    output.line(f"{'paths':<14} whose smallest singular value is {tube.singular_value:.3f} or more")
    for name, most in tube.links.items():
        output.line(f"{'link':<14} {name:<24} {1e3 * most:6.2f} mm")
    output.written(out)
    output.result(
        {"arm": found.arm, "runs": len(logs), "least_share": share, "written": str(out)}, "robot-measure-tube"
    )
