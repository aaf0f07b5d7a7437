"""``omniservo plan``."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal

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
from omniservo.files import require_file, writable, write_whole

if TYPE_CHECKING:
    from omniservo.estimation import TwoViewEstimate
    from omniservo.planning import Plan, PlanningProblem


MethodOption = Annotated[
    Literal["certified", "paper"],
    typer.Option("--method", help="Proven for the whole path, or the 2012 paper's own search."),
]
EstimateOption = Annotated[
    Path | None,
    typer.Option("--estimate", help="What estimate --out wrote: its goal and points are planned with."),
]
ObstaclesOption = Annotated[
    Path | None,
    typer.Option("--obstacles", help="With an estimate, in PROBLEM's place: obstacles and margins."),
]
ClearanceOption = Annotated[
    float | None,
    typer.Option("--clearance", help="With --obstacles: replaces the file's clearance, in metres."),
]
RiskOption = Annotated[
    float | None,
    typer.Option("--risk", help="With an estimate: chance that a constraint is violated (0.01)."),
]
BudgetOption = Annotated[
    float | None,
    typer.Option("--time-budget", help="Seconds; the best plan found in them, instead of the first."),
]
DrawOption = Annotated[
    Path | None,
    typer.Option("--draw", help="Draw the moment with the least left, or the worst violation (.png, .svg)."),
]


def plan(
    problem: Annotated[Path | None, typer.Argument(help="Planning problem, JSON or YAML.")] = None,
    out: Annotated[Path | None, typer.Option("--out", help="Write the plan here.")] = None,
    draw: DrawOption = None,
    method: MethodOption = "certified",
    quality: Annotated[
        Literal["effort", "margin"],
        typer.Option("--quality", help="Least bending energy, or the largest minimum margin."),
    ] = "effort",
    time_budget: BudgetOption = None,
    estimate: EstimateOption = None,
    obstacles: ObstaclesOption = None,
    clearance: ClearanceOption = None,
    risk: RiskOption = None,
    seed: SeedOption = 0,
    force: ForceOption = False,
    as_json: JsonOption = False,
    quiet: QuietOption = False,
) -> None:
    """Plan a camera path that is proven to keep every constraint of the problem.

    A plan that is not certified is drawn beside --out, at the moment of its worst violation.
    """
    output, results = Output(as_json, quiet), _Results(out, draw, force)
    for path in (problem, estimate, obstacles):
        if path is not None:
            require_file(path)
    if estimate is not None:
        if method != "certified" or quality != "effort" or time_budget is not None:
            raise InputError("plan: --estimate given; it goes with neither method, quality nor time budget")
        asked = _Asked(problem, estimate, obstacles, clearance, 0.01 if risk is None else risk, seed)
        _plan_with_risk(asked, results, output)
        return
    for name, given in (("--risk", risk), ("--obstacles", obstacles), ("--clearance", clearance)):
        if given is not None:
            raise InputError(f"plan: {name} given without --estimate, which it belongs to")
    if problem is None:
        raise InputError("plan: give a PROBLEM, or --estimate with --obstacles")
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


@dataclass(frozen=True)
class _Results:
    """Where a plan and its image go."""

    out: Path | None
    draw: Path | None
    force: bool

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
            drawn = self.out.with_suffix(".png")
        if drawn is not None:
            with output.working("drawing"):
                from omniservo.reporting.figure_files import image_bytes
                from omniservo.reporting.moment_figure import draw_moment

                picture = image_bytes(draw_moment(plan), drawn.suffix.removeprefix("."))
            write_whole(drawn, picture, force=self.force)
            output.written(drawn)


@dataclass(frozen=True)
class _Asked:
    """What is planned with an estimate."""

    problem: Path | None
    estimate: Path
    obstacles: Path | None
    clearance: float | None
    risk: float
    seed: int

    def load(self) -> tuple[PlanningProblem, TwoViewEstimate]:
        """Return what the files say.

        Raises:
            InputError: a file is not legal, or not exactly one of problem and obstacles is given.
        """
        from omniservo.estimation import TwoViewEstimate
        from omniservo.planning import PlanningProblem
        from omniservo.risk import problem_around

        known = TwoViewEstimate.load(self.estimate)
        if self.problem is not None and self.obstacles is None and self.clearance is None:
            return PlanningProblem.load(self.problem), known
        if self.problem is None and self.obstacles is not None:
            return problem_around(known, self.obstacles, clearance=self.clearance), known
        raise InputError("plan: --estimate given; it goes with a PROBLEM, or with --obstacles [--clearance]")


def _plan_with_risk(asked: _Asked, results: _Results, output: Output) -> None:
    """Plan to the estimate's goal with margins that its uncertainty needs."""
    with output.working("loading") as progress:
        from omniservo.geometry.compiler_watch import CompilerWatch
        from omniservo.risk import plan_with_risk

        progress("planning with risk")
        problem, known = asked.load()
        with CompilerWatch() as watch:
            found = plan_with_risk(problem, known, risk=asked.risk, seed=asked.seed)
    results.write(found.plan, output)
    _say_notices(problem.notices, output)
    used = f"goal and {int(known.inliers.sum())} points of {asked.estimate}"
    output.line(used if asked.problem is None else f"{used} instead of the problem's own")
    output.line(
        f"{found.plan.status} in {_time(found.seconds, watch.seconds)}; {100 * found.predicted:.2g}% of"
        f" {found.samples} samples violate a constraint (at most {100 * found.predicted_bound:.2g}%, required"
        f" {100 * asked.risk:g}%)"
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
