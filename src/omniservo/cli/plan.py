"""``omniservo plan``."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal

import typer

from omniservo.cli.grouped import grouped
from omniservo.cli.output import ForceOption, Output, SeedOption, answer_is_no, with_unit
from omniservo.errors import InputError
from omniservo.files import exists, require_file, writable, write_whole
from omniservo.geometry.arrays import finite_number

if TYPE_CHECKING:
    from omniservo.estimation import TwoViewEstimate
    from omniservo.planning import Plan, PlanningProblem


@dataclass(frozen=True)
class _Results:
    """Where a plan and its image go."""

    out: Annotated[Path | None, typer.Option("--out", help="Write the plan here.")] = None
    draw: Annotated[
        Path | None,
        typer.Option(
            "--draw", help="Draw the moment with the least left, or the worst violation (.png, .svg)."
        ),
    ] = None
    force: ForceOption = False

    def __post_init__(self) -> None:
        for path in (self.out, self.draw):
            if path is not None:
                writable(path, force=self.force)
        if self.draw is not None and self.draw.suffix not in (".png", ".svg"):
            raise InputError(f"--draw: {self.draw} given; legal: a file that ends with .png or .svg")

    def next_step(self) -> str:
        """Return what shows why there is no certified plan; empty where it was drawn."""
        return "" if self.out or self.draw else "--draw FILE.png draws the moment that is worst"

    def write(self, plan: Plan, output: Output) -> None:
        """Write the plan, and the image that was requested or that a refused plan has beside it."""
        if self.out is not None:
            plan.save(self.out, force=self.force)
            output.written(self.out)
        drawn = self.draw
        if drawn is None and self.out is not None and plan.status != "certified":
            beside = self.out.with_suffix(".png")
            drawn = beside if self.force or not exists(beside) else None
        if drawn is not None:
            with output.working("drawing"):
                from omniservo.reporting.figure_files import image_bytes
                from omniservo.reporting.moment_figure import draw_moment

                picture = image_bytes(draw_moment(plan), drawn.suffix.removeprefix("."))
            write_whole(drawn, picture, force=self.force)
            output.written(drawn)


@dataclass(frozen=True)
class _Uncertain:
    """An estimate to plan with, and what belongs to it."""

    estimate: Annotated[
        Path | None,
        typer.Option("--estimate", help="What estimate --out wrote: its goal and points are planned with."),
    ] = None
    obstacles: Annotated[
        Path | None,
        typer.Option("--obstacles", help="With an estimate, in PROBLEM's place: obstacles and margins."),
    ] = None
    clearance: Annotated[
        float | None,
        typer.Option("--clearance", help="With --obstacles: replaces the file's clearance, in metres."),
    ] = None
    risk: Annotated[
        float | None,
        typer.Option("--risk", help="With an estimate: chance that a constraint is violated (0.01)."),
    ] = None

    def load(self, problem: Path | None, estimate: Path) -> tuple[PlanningProblem, TwoViewEstimate]:
        """Return what the files say.

        Raises:
            InputError: a file is not legal, or not exactly one of problem and obstacles is given.
        """
        from omniservo.estimation import TwoViewEstimate
        from omniservo.planning import PlanningProblem
        from omniservo.risk import problem_around

        known = TwoViewEstimate.load(estimate)
        if problem is not None and self.obstacles is None and self.clearance is None:
            return PlanningProblem.load(problem), known
        if problem is None and self.obstacles is not None:
            return problem_around(known, self.obstacles, clearance=self.clearance), known
        raise InputError("plan: --estimate given; it goes with a PROBLEM, or with --obstacles [--clearance]")


@grouped
def plan(
    problem: Annotated[Path | None, typer.Argument(help="Planning problem, JSON or YAML.")] = None,
    *,
    results: _Results,
    method: Annotated[
        Literal["certified", "paper"],
        typer.Option("--method", help="Proven for the whole path, or the 2012 paper's own search."),
    ] = "certified",
    quality: Annotated[
        Literal["effort", "margin"],
        typer.Option("--quality", help="Least bending energy, or the largest minimum margin."),
    ] = "effort",
    time_budget: Annotated[
        float | None,
        typer.Option("--time-budget", help="Seconds; the best plan found in them, instead of the first."),
    ] = None,
    uncertain: _Uncertain,
    seed: SeedOption = 0,
    output: Output,
) -> None:
    """Plan a camera path that is proven to keep every constraint of the problem.

    A plan that is not certified is drawn beside --out, at the moment of its worst violation.
    """
    estimate, obstacles = uncertain.estimate, uncertain.obstacles
    risk, clearance = uncertain.risk, uncertain.clearance
    for path in (problem, estimate, obstacles):
        if path is not None:
            require_file(path)
    if estimate is not None:
        if method != "certified" or quality != "effort" or time_budget is not None:
            raise InputError("plan: --estimate given; it goes with neither method, quality nor time budget")
        _plan_with_risk(problem, estimate, uncertain, seed, results, output)
        return
    for name, given in (("--risk", risk), ("--obstacles", obstacles), ("--clearance", clearance)):
        if given is not None:
            raise InputError(f"plan: {name} given without --estimate, which it belongs to")
    if problem is None:
        raise InputError("plan: give a PROBLEM, or --estimate with --obstacles")
    if time_budget is not None:
        finite_number("--time-budget", time_budget, above=0.0)
    with output.working("loading") as progress:
        from omniservo.geometry.compiler_watch import CompilerWatch
        from omniservo.planning import PlanningProblem, plan_path

        progress("planning", seconds=time_budget)
        loaded = PlanningProblem.load(problem)
        with CompilerWatch() as watch:
            result = plan_path(loaded, method=method, quality=quality, time_budget=time_budget, seed=seed)
    results.write(result, output)  # before any words: who reads them may have gone
    _say_notices(loaded.notices, output)
    output.line(f"{result.status} in {_time(result.seconds, watch.seconds)} (method {method})")
    if result.certificate is not None:
        for c in result.certificate.constraints:
            output.line(f"  {c.name:<36} {with_unit(c.margin, c.unit)} at w = {c.w:.4f}")
    output.result({**result.to_dict(), "notices": loaded.notices})
    if result.status != "certified":
        raise answer_is_no(f"{result.status}: {result.reason}", results.next_step())


def _say_notices(notices: tuple[str, ...], output: Output) -> None:
    for notice in notices:
        output.line(f"notice: {notice}")


def _plan_with_risk(
    given: Path | None, estimate: Path, uncertain: _Uncertain, seed: int, results: _Results, output: Output
) -> None:
    """Plan to the estimate's goal with margins that its uncertainty needs."""
    risk = 0.01 if uncertain.risk is None else uncertain.risk
    with output.working("loading") as progress:
        from omniservo.geometry.compiler_watch import CompilerWatch
        from omniservo.risk import plan_with_risk

        progress("planning with risk")
        problem, known = uncertain.load(given, estimate)
        with CompilerWatch() as watch:
            found = plan_with_risk(problem, known, risk=risk, seed=seed)
    results.write(found.plan, output)
    _say_notices(problem.notices, output)
    used = f"goal and {int(known.inliers.sum())} points of {estimate}"
    output.line(used if given is None else f"{used} instead of the problem's own")
    output.line(
        f"{found.plan.status} in {_time(found.seconds, watch.seconds)}; {100 * found.predicted:.2g}% of"
        f" {found.samples} samples violate a constraint (at most {100 * found.predicted_bound:.2g}%, required"
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
    output.result({**found.plan.to_dict(), "risk": found.to_dict(), "notices": problem.notices})
    if not found.ok:
        raise answer_is_no(f"{found.plan.status}: {found.plan.reason}", results.next_step())


def _time(seconds: float, code: float) -> str:
    """Return how long planning took, and what of it was loading code, as a process's first plan does."""
    planned = f"{1e3 * seconds:.2f} ms"
    return f"{planned}, of which {1e3 * code:.2f} ms loading or compiling code" if code else planned
