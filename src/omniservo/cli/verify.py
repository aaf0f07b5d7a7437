"""``omniservo verify``."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from omniservo.cli.grouped import grouped
from omniservo.cli.output import Output, answer_is_no, with_unit

if TYPE_CHECKING:
    from omniservo.planning import PlanningProblem


@grouped
def verify(
    plan: Annotated[Path, typer.Argument(help="A saved plan.")],
    *,
    problem: Annotated[
        Path | None,
        typer.Option(
            "--problem", help="The problem that was meant, JSON or YAML: the plan's must say the same."
        ),
    ] = None,
    output: Output,
) -> None:
    """Check a saved plan independently of the planner, in exact arithmetic."""
    from omniservo.errors import InputError
    from omniservo.verification import PlanFileError, verify_plan

    with output.working("verifying"):
        try:
            certificate = verify_plan(plan, problem=None if problem is None else _loaded(problem))
        except PlanFileError as error:
            raise InputError(str(error)) from None
    output.line(f"{certificate.status}: {len(certificate.constraints)} constraints judged")
    if certificate.differences == ():
        output.line(f"  the plan's problem is that of {problem}")
    for c in certificate.constraints:
        output.line(f"  {c.name:<36} {with_unit(c.margin, c.unit)}: {c.verdict}")
    output.result(certificate.to_dict(), "verify")
    if certificate.status != "certified":
        reason = f"{certificate.status}: {'; '.join(certificate.reasons)}"
        raise answer_is_no(reason, "omniservo plan makes another; do not move along this one")


def _loaded(problem: Path) -> PlanningProblem:
    """Return the problem of a file, with its camera and the files that it names."""
    from omniservo.planning import PlanningProblem

    return PlanningProblem.load(problem)
