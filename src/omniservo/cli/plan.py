"""``omniservo plan``."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Literal

import typer

from omniservo.cli.output import ForceOption, JsonOption, Output, QuietOption, SeedOption, answer_is_no


def plan(
    problem: Annotated[Path, typer.Argument(help="Planning problem, JSON or YAML.")],
    out: Annotated[Path | None, typer.Option("--out", help="Write the plan here.")] = None,
    method: Annotated[Literal["certified", "paper"], typer.Option("--method")] = "certified",
    quality: Annotated[
        Literal["effort", "margin"],
        typer.Option("--quality", help="Least bending energy, or largest smallest margin."),
    ] = "effort",
    time_budget: Annotated[
        float | None,
        typer.Option("--time-budget", help="Seconds; the best plan found in them, instead of the first."),
    ] = None,
    seed: SeedOption = 0,
    force: ForceOption = False,
    as_json: JsonOption = False,
    quiet: QuietOption = False,
) -> None:
    """Plan a camera path that is proven to keep every constraint of the problem."""
    from omniservo.files import writable
    from omniservo.planning import PlanningProblem, plan_path

    output = Output(as_json, quiet)
    if out is not None:
        writable(out, force=force)
    with output.working("planning"):
        result = plan_path(
            PlanningProblem.load(problem), method=method, quality=quality, time_budget=time_budget, seed=seed
        )
    if out is not None:
        result.save(out, force=force)
    output.line(f"{result.status} in {1e3 * result.seconds:.2f} ms (method {method})")
    if result.certificate is not None:
        for c in result.certificate.constraints:
            output.line(f"  {c.name:<36} {c.margin:+.6g} {c.unit} at w = {c.w:.4f}")
    if out is not None:
        output.line(f"written: {out}")
    output.result(result.to_dict())
    if result.status != "certified":
        raise answer_is_no(f"{result.status}: {result.reason}")
