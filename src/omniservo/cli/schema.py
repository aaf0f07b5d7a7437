"""``omniservo schema``."""

from __future__ import annotations

import json
from typing import Annotated

import typer

from omniservo.cli.grouped import grouped
from omniservo.cli.output import Output


@grouped
def schema(
    file_format: Annotated[
        str | None, typer.Argument(metavar="[FORMAT]", help="As plan, or omniservo.plan/1.")
    ] = None,
    *,
    output: Output,
) -> None:
    """Print the JSON schema of a file format; without FORMAT, list the formats."""
    from omniservo.schemas import FORMATS, json_schema, short_name

    if file_format is not None:
        found = json_schema(file_format)
        output.line(json.dumps(found, indent=2, ensure_ascii=False))
        output.document(found)
        return
    listed = [{"name": short_name(full), "format": full, "summary": f.summary} for full, f in FORMATS.items()]
    for known in listed:
        output.line(f"{known['name']:<25} {known['format']:<37} {known['summary']}")
    output.result({"formats": listed}, "schema")
