"""``omniservo plan``."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Literal

import typer

from omniservo.cli.output import (
    ForceOption,
    JsonOption,
    Output,
    QuietOption,
    SeedOption,
    answer_is_no,
    with_unit,
)
from omniservo.errors import InputError
from omniservo.files import require_file, writable


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
    output = Output(as_json, quiet)
    if out is not None:
        writable(out, force=force)
    require_file(problem)
    if estimate is not None:
        if method != "certified" or quality != "effort" or time_budget is not None:
            raise InputError("plan: --estimate given; it goes with neither method, quality nor time budget")
        _plan_with_risk(problem, estimate, 0.01 if risk is None else risk, out, seed, force, output)
        return
    if risk is not None:
        raise InputError("plan: --risk given without --estimate, which says what is uncertain")
    with output.working("loading") as progress:
        from omniservo.geometry.compiler_watch import CompilerWatch
        from omniservo.planning import PlanningProblem, plan_path

        progress("planning")
        asked = PlanningProblem.load(problem)
        with CompilerWatch() as watch:
            result = plan_path(asked, method=method, quality=quality, time_budget=time_budget, seed=seed)
    if out is not None:
        result.save(out, force=force)
    _say_notices(asked.notices, output)
    output.line(f"{result.status} in {_time(result.seconds, watch.seconds)} (method {method})")
    if result.certificate is not None:
        for c in result.certificate.constraints:
            output.line(f"  {c.name:<36} {with_unit(c.margin, c.unit)} at w = {c.w:.4f}")
    if out is not None:
        output.written(out)
    output.result({**result.to_dict(), "notices": asked.notices})
    if result.status != "certified":
        raise answer_is_no(f"{result.status}: {result.reason}")


def _say_notices(notices: tuple[str, ...], output: Output) -> None:
    for notice in notices:
        output.line(f"notice: {notice}")


def _plan_with_risk(
    problem: Path, estimate: Path, risk: float, out: Path | None, seed: int, force: bool, output: Output
) -> None:
    """Plan to the estimate's goal with margins that its uncertainty needs."""
    with output.working("loading") as progress:
        from omniservo.estimation import TwoViewEstimate
        from omniservo.geometry.compiler_watch import CompilerWatch
        from omniservo.planning import PlanningProblem, plan_with_risk

        progress("planning with risk")
        asked, known = PlanningProblem.load(problem), TwoViewEstimate.load(estimate)
        with CompilerWatch() as watch:
            found = plan_with_risk(asked, known, risk=risk, seed=seed)
    if out is not None:
        found.plan.save(out, force=force)
    _say_notices(asked.notices, output)
    output.line(f"goal and {int(known.inliers.sum())} points of {estimate} instead of the problem's own")
    output.line(
        f"{found.plan.status} in {_time(found.seconds, watch.seconds)}; {100 * found.predicted:.2g}% of"
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
        output.written(out)
    output.result({**found.plan.to_dict(), "risk": found.to_dict(), "notices": asked.notices})
    if not found.ok:
        raise answer_is_no(f"{found.plan.status}: {found.plan.reason}")


def _time(seconds: float, code: float) -> str:
    """Return how long planning took, and what of it was loading code, as a process's first plan does."""
    planned = f"{1e3 * seconds:.2f} ms"
    return f"{planned}, of which {1e3 * code:.2f} ms loading or compiling code" if code else planned
