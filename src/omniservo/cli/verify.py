"""``omniservo verify``."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from omniservo.cli.output import JsonOption, Output, QuietOption, answer_is_no, with_unit


def verify(
    plan: Annotated[Path, typer.Argument(help="A saved plan.")],
    as_json: JsonOption = False,
    quiet: QuietOption = False,
) -> None:
    """Check a saved plan in exact arithmetic, believing nothing that the planner says."""
    from omniservo.errors import InputError
    from omniservo.verification import PlanFileError, verify_plan

    output = Output(as_json, quiet)
    with output.working("verifying"):
        try:
            certificate = verify_plan(plan)
        except PlanFileError as error:
            raise InputError(str(error)) from None
    output.line(f"{certificate.status}: {len(certificate.constraints)} constraints judged")
    for c in certificate.constraints:
        output.line(f"  {c.name:<36} {with_unit(c.margin, c.unit)}: {c.verdict}")
    output.result(certificate.to_dict())
    if certificate.status != "certified":
        raise answer_is_no(f"{certificate.status}: {'; '.join(certificate.reasons)}")
