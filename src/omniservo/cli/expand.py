"""``omniservo robot expand``."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from omniservo.cli.grouped import grouped
from omniservo.cli.output import ForceOption, Output
from omniservo.cli.robot_options import PackageOption, arguments_of, packages_of


@grouped
def expand(
    file: Annotated[Path, typer.Argument(help="A xacro file whose author you trust.")],
    arguments: Annotated[
        list[str] | None, typer.Argument(help="NAME:=VALUE, the file's own arguments.")
    ] = None,
    *,
    out: Annotated[Path, typer.Option("--out", help="Write the URDF here.")],
    package: PackageOption = None,
    force: ForceOption = False,
    output: Output,
) -> None:
    """Expand a xacro file to URDF, which evaluates the Python expressions in it."""
    from omniservo.files import writable, write_whole
    from omniservo.files.xacro_files import expand_xacro

    writable(out, force=force)
    text = expand_xacro(file, arguments_of(arguments), packages_of(package))
    write_whole(out, text, force=force)
    output.line(f"written: {out}")
    output.result({"written": str(out)}, "robot-expand")
