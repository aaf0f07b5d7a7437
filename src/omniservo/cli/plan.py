"""``omniservo plan``."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Literal

import typer

from omniservo.cli.output import ForceOption, JsonOption, Output, QuietOption, SeedOption, answer_is_no
from omniservo.errors import InputError


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
    estimate: Annotated[
        Path | None,
        typer.Option("--estimate", help="Estimate file: its goal and points take the problem's place."),
    ] = None,
    risk: Annotated[
        float | None,
        typer.Option("--risk", help="With an estimate: probability of violating a demand (0.01)."),
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
    if estimate is not None:
        if method != "certified" or quality != "effort" or time_budget is not None:
            raise InputError("plan: --estimate given; it goes with neither method, quality nor time budget")
        _plan_with_risk(problem, estimate, 0.01 if risk is None else risk, out, seed, force, output)
        return
    if risk is not None:
        raise InputError("plan: --risk given without --estimate, which says what is uncertain")
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


def _plan_with_risk(
    problem: Path, estimate: Path, risk: float, out: Path | None, seed: int, force: bool, output: Output
) -> None:
    """Plan to the estimate's goal with margins that its uncertainty needs."""
    from omniservo.estimation import TwoViewEstimate
    from omniservo.planning import PlanningProblem, plan_with_risk

    with output.working("planning with risk"):
        asked, known = PlanningProblem.load(problem), TwoViewEstimate.load(estimate)
        found = plan_with_risk(asked, known, risk=risk, seed=seed)
    if out is not None:
        found.plan.save(out, force=force)
    output.line(f"goal and {int(known.inliers.sum())} points of {estimate} instead of the problem's own")
    output.line(
        f"{found.plan.status} in {1e3 * found.seconds:.0f} ms; {100 * found.predicted:.2g}% of"
        f" {found.samples} samples violate a demand (at most {100 * found.predicted_bound:.2g}%, asked"
        f" {100 * risk:g}%)"
    )
    output.line(
        f"for uncertainty: {1e3 * found.extra_clearance:.3g} mm more clearance,"
        f" {found.extra_visibility:.3g} px more visibility margin"
    )
    for name, margin in found.margins.items():
        parts = ", ".join(f"{source} {taken:.3g}" for source, taken in margin.parts.items())
        output.line(
            f"  {name:<28} planned {margin.planned:+.4g} {margin.unit}, at that risk {margin.executed:+.4g};"
            f" taken by {parts}"
        )
    if found.ok:
        output.line(found.advice)
    if out is not None:
        output.line(f"written: {out}")
    output.result({**found.plan.to_dict(), "risk": found.to_dict()})
    if not found.ok:
        raise answer_is_no(f"{found.plan.status}: {found.plan.reason}")
