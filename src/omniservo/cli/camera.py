"""``omniservo camera show | convert``."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Annotated

import typer

from omniservo.cli.output import ForceOption, JsonOption, Output, QuietOption

app = typer.Typer(help="Show and convert cameras.", no_args_is_help=True)

NameOption = Annotated[str | None, typer.Option("--name", help="Which camera of a file with several.")]


@app.command("show")
def show(
    camera: Annotated[str, typer.Argument(help="A calibration file or a preset's name.")],
    name: NameOption = None,
    as_json: JsonOption = False,
    quiet: QuietOption = False,
) -> None:
    """Print a camera: its parameters, its domain and its field of view."""
    from omniservo.calibration import load_camera
    from omniservo.cameras import PRESETS, preset

    output = Output(as_json, quiet)
    model = preset(camera) if camera in PRESETS and name is None else load_camera(camera, name=name)
    fields = model.to_dict()
    for field, value in fields.items():
        output.line(f"{field:<14} {value}")
    output.line(f"{'usable angle':<14} {math.degrees(model.usable_angle):.3f} deg from the axis")
    limits = model.image_limits()
    output.line(f"{'limits':<14} {', '.join(limits.names)}")
    output.result({**fields, "usable_angle": model.usable_angle, "limits": list(limits.names)})


@app.command("convert")
def convert(
    camera: Annotated[Path, typer.Argument(help="A calibration file.")],
    out: Annotated[Path, typer.Argument(help="Where to write.")],
    to: Annotated[str, typer.Option("--to", help="Format to write: own, mei, kalibr.")],
    name: NameOption = None,
    force: ForceOption = False,
    as_json: JsonOption = False,
    quiet: QuietOption = False,
) -> None:
    """Convert a calibration file to another format."""
    from omniservo.calibration import load_camera, save_camera
    from omniservo.files import writable

    output = Output(as_json, quiet)
    writable(out, force=force)
    save_camera(load_camera(camera, name=name), out, to, force=force)
    output.line(f"written: {out}")
    output.result({"out": str(out), "format": to})
