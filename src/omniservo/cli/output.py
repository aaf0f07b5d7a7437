"""What every command shares: where words go, and which exit code they mean."""

from __future__ import annotations

import json
import math
import sys
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any

import typer
from rich.console import Console

from omniservo.cli.progress import DOING, Progress
from omniservo.errors import InputError
from omniservo.files import exists

DONE = 0
"""the job is done"""
ANSWER_IS_NO = 1
"""computed, and the answer is no"""
WRONG_INPUT = 2
"""the input or the call is wrong"""
INTERRUPTED = 130
"""by Ctrl-C"""
UNREAD = 141
"""who reads standard output, left, as head does"""

ForceOption = Annotated[bool, typer.Option("--force", help="Replace an existing file or folder.")]
SeedOption = Annotated[int, typer.Option("--seed", min=0, max=2**63 - 1, help="Seed of everything random.")]


@dataclass(frozen=True)
class Output:
    """Where a command's words go."""

    as_json: Annotated[bool, typer.Option("--json", help="One JSON object on standard output.")] = False
    quiet: Annotated[bool, typer.Option("--quiet", help="Nothing on standard output.")] = False

    def line(self, text: str) -> None:
        """Print a line for a person; nothing under --json and --quiet."""
        if not (self.as_json or self.quiet):
            Console(highlight=False, emoji=False, soft_wrap=True).print(text, markup=False)

    def result(self, values: dict[str, Any], name: str = "") -> None:
        """Print the command's JSON object under --json, with the format that `omniservo schema` describes.

        Args:
            values: its fields; those of a file bring their format.
            name: of the output, where they are no file's.
        """
        self.document({"format": f"omniservo.{name}-output/1", **values} if name else values)

    def document(self, values: dict[str, Any]) -> None:
        """Print a JSON object under --json that is what it is: a schema."""
        if self.as_json:
            print(json.dumps(_plain(values), allow_nan=False), flush=True)

    def written(self, path: Path, more: str = "") -> None:
        """Say that a file is there, and what more there is to say of it."""
        DOING.written.append(path)
        self.line(f"written: {path}{more}")

    def working(self, what: str, *, compiles: bool = False) -> Progress:
        """Show progress on standard error while the block runs; call what is entered to change the words."""
        return Progress(what, silent=self.quiet or self.as_json, compiles=compiles)


def with_unit(value: float, unit: str) -> str:
    """Return a signed number with its unit; a number that has none has no "1" behind it."""
    return f"{value:+.6g}" if unit == "1" else f"{value:+.6g} {unit}"


def refuse_file(out: Path | None) -> None:
    """Refuse an ``--out`` that is no folder before the work is done, not after it.

    Raises:
        InputError: it is a file.
    """
    if out is not None and exists(out) and not out.is_dir():
        raise InputError(f"--out: {out}: a file; a folder is needed")


def answer_is_no(reason: str, next_step: str = "") -> typer.Exit:
    """Say why the answer is no and what to do next, and return the exit to raise."""
    print(f"omniservo: {reason}{f'; next: {next_step}' if next_step else ''}", file=sys.stderr)
    return typer.Exit(ANSWER_IS_NO)


def _plain(value: Any) -> Any:
    """JSON has no NaN and no infinity: they become null."""
    if isinstance(value, dict):
        return {str(k): _plain(v) for k, v in value.items()}
    if isinstance(value, list | tuple):
        return [_plain(v) for v in value]
    if hasattr(value, "tolist"):
        return _plain(value.tolist())
    if isinstance(value, float) and not math.isfinite(value):
        return None
    return value
