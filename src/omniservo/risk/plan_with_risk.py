"""Plans whose margins are as wide as an uncertain estimate needs them."""

from __future__ import annotations

import math
import time
from collections.abc import Callable
from dataclasses import replace
from functools import partial

import numpy as np
import numpy.typing as npt

from omniservo.errors import InputError, spelled
from omniservo.estimation import TwoViewEstimate
from omniservo.estimation.refinement.pose_refinement import LEAST_POINTS
from omniservo.geometry.arrays import FloatArray, IntArray, finite_number
from omniservo.planning.plan import Plan
from omniservo.planning.planning_problem import PlanningProblem
from omniservo.risk.advice import sources_of, what_dominates, what_would_help
from omniservo.risk.executions import IMAGE, constraints_of
from omniservo.risk.problem_around import NOT_METRIC
from omniservo.risk.risk_plan import RiskPlan, RiskReasons, UncertainMargin
from omniservo.risk.safe_path import (
    STRICTER,
    Planner,
    SafePath,
    camera_alone,
    critical_places,
    safe_path,
    upper_bound,
)
from omniservo.risk.samples import RiskSamples

LEAST_RISK = 1e-4
MOST_RISK = 0.5

PLANNED_PLACES = 101
"""Places where the planned margins are checked."""


def plan_with_risk(
    problem: PlanningProblem,
    estimate: TwoViewEstimate,
    *,
    risk: float = 0.01,
    points: npt.ArrayLike | None = None,
    seed: int = 0,
    planner: Planner = camera_alone,
) -> RiskPlan:
    """Return a certified plan that the servo, led by an uncertain estimate, violates with at most ``risk``.

    The estimate's goal and points take the place of the problem's. Samples of what the points may truly be
    (`TwoViewEstimate.sample`) are executed: the servo keeps the points it sees where the plan sees the
    estimated ones, so the camera goes another way than planned. A sample is violated where that way, or what
    is seen from it, leaves a constraint of the problem unmet. Margins are widened until few enough are.

    Args:
        problem: what to keep; obstacles in the initial camera frame, as exact as stated.
        estimate: metric, of status "ok", with its uncertainty.
        risk: probability that any constraint is violated, 0.0001 to 0.5.
        points: rows (m,) of the estimated points that the servo follows and that stay in view, at least
            four, each once; None: all inliers.
        seed: of the samples, and of planning.
        planner: what plans the path: the camera alone, or with an arm.

    Raises:
        InputError: no pose, no scale, no uncertainty in the estimate, an illegal risk, a point that is
            no inlier or stands twice, fewer points than a servo needs, or what planning refuses.
    """
    begin = time.perf_counter()
    finite_number("risk", risk, minimum=LEAST_RISK, maximum=MOST_RISK)
    seed = int(finite_number("seed", seed, minimum=0))
    rows = followed_rows(estimate, points)
    samples = RiskSamples(problem_of_estimate(problem, estimate, rows), estimate, rows, risk, seed)
    return searched(samples, begin, planner)


def searched(
    samples: RiskSamples, begin: float, planner: Planner, keeps: Callable[[Plan], str] = lambda plan: ""
) -> RiskPlan:
    """Return the plan that samples are searched for, at their risk.

    Args:
        samples: of what is uncertain.
        begin: when planning began [s].
        planner: what plans.
        keeps: says what a plan misses by samples that had no part in the search; "": nothing.
    """
    risk, count, draws, extra = samples.risk, samples.count, samples.draws, None
    for share in STRICTER:
        found = safe_path(samples.problem, draws, share * risk, samples.seed, planner, extra)
        if found.verdict is None:
            return RiskPlan(False, found.plan, risk, 1.0, 1.0, count, 0.0, 0.0, _since(begin), _no_plan)
        violations = int(samples.check.violated_at(found.verdict.places).sum())
        bound = upper_bound(violations, count, samples.check.repeats)
        missing = samples.too_alike or keeps(found.plan)
        ok = bound <= risk and not missing
        if ok or not found.ok:
            break
        draws, extra = draws[-1:], found.extra
    predicted, (most, image) = violations / count, _most_added(found)
    reasons = partial(_reasons, samples, found, predicted, "" if ok else missing, None if ok else planner)
    return RiskPlan(ok, found.plan, risk, predicted, bound, count, most, image, _since(begin), reasons)


def _no_plan() -> RiskReasons:
    """Return why there is no path that samples could be executed on."""
    return RiskReasons({}, "there is none without uncertainty either")


def _reasons(
    samples: RiskSamples, found: SafePath, predicted: float, missing: str, planner: Planner | None
) -> RiskReasons:
    """Return why a path is as it is; ``planner`` None: its risk is small enough."""
    report = _uncertain_margins(samples, found)
    if planner is None:
        return RiskReasons(report, what_dominates(report))
    if missing:
        advice, reason = what_dominates(report), missing
    else:
        reason = _reason(report, predicted, samples.risk)
        advice = what_would_help(
            sources_of(samples.estimate),
            report,
            lambda kept: (
                safe_path(samples.problem, samples.draws_of(kept), samples.risk, samples.seed, planner).ok
            ),
        )
    return RiskReasons(report, advice, f"{reason}; {advice}")


def _most_added(found: SafePath) -> tuple[float, float]:
    """Return the most that was added to a distance [m], and what was to the image's margin [px]."""
    extra = dict(zip(constraints_of(found.plan.problem), found.extra.tolist(), strict=True))
    image = extra.pop(IMAGE)
    return max(extra.values(), default=0.0), image


def _since(begin: float) -> float:
    return time.perf_counter() - begin


def _reason(report: dict[str, UncertainMargin], predicted: float, risk: float) -> str:
    """Say by how much the best attempt fails, and where."""
    worst = min(report, key=lambda name: report[name].left)
    found, digits = report[worst], 1e3 if report[worst].unit == "m" else 1.0
    unit = "mm" if found.unit == "m" else "px"
    return (
        f"no path was found with a risk of {risk:g}: the best one violates a constraint in "
        f"{100 * predicted:.2g}%"
        f" of the samples; {worst}: {digits * found.planned:.3g} {unit} planned,"
        f" {digits * found.executed:.3g} {unit} left at that risk"
    )


def followed_rows(estimate: TwoViewEstimate, points: npt.ArrayLike | None) -> IntArray:
    """Return the rows of the points to plan for, checked."""
    if points is None:
        return np.flatnonzero(estimate.inliers)
    rows = np.asarray(points)
    if rows.ndim != 1 or not len(rows) or rows.dtype.kind not in "iu":
        raise InputError(f"points: {spelled(points)} given; row numbers of the estimated points are needed")
    known = np.isin(rows, np.flatnonzero(estimate.inliers))
    if not known.all():
        raise InputError(f"points: row {rows[~known][0]} given, which is no inlier of the estimate")
    if len(np.unique(rows)) < max(len(rows), LEAST_POINTS):
        raise InputError(
            f"points: {spelled(rows.tolist())} given; at least {LEAST_POINTS}, each once, are needed"
        )
    return rows.astype(np.int64)


def problem_of_estimate(
    problem: PlanningProblem, estimate: TwoViewEstimate, rows: IntArray
) -> PlanningProblem:
    """Return the problem with the estimate's goal and these of its points instead of its own.

    Raises:
        InputError: the estimate has no pose, or no metric scale.
    """
    if estimate.initial_T_goal is None:
        raise InputError(f"estimate: status {estimate.status!r}: no pose to plan to; {estimate.message}")
    if not estimate.is_metric:
        raise InputError(NOT_METRIC)
    return replace(problem, points=estimate.points[rows], initial_T_goal=estimate.initial_T_goal)


def _uncertain_margins(samples: RiskSamples, found: SafePath) -> dict[str, UncertainMargin]:
    """Return what uncertainty, and each source alone, does to every constraint of a path that was found."""
    path, check, critical = found.plan.path, samples.check, critical_places(found.plan)
    if path is None or found.verdict is None:
        return {}
    places = np.unique(np.concatenate((np.linspace(0.0, 1.0, PLANNED_PLACES), critical)))
    planned, left = check.planned(path, places), _left(check.margins_at(found.verdict.places), samples.risk)
    sources = sources_of(samples.estimate)
    parts = {
        source: planned
        - (left if len(sources) == 1 else _left(samples.alone(source).margins(path, critical), samples.risk))
        for source in sources
    }
    return {
        name: UncertainMargin(
            "px" if name == IMAGE else "m",
            float(planned[g]),
            float(left[g]),
            float(found.extra[g]),
            {source: float(taken[g]) for source, taken in parts.items()},
        )
        for g, name in enumerate(check.constraints)
        if math.isfinite(planned[g])
    }


def _left(margins: FloatArray, risk: float) -> FloatArray:
    """Return what is left of each constraint (d,) but for a share ``risk`` of the samples (K, d)."""
    return np.asarray(np.quantile(margins, risk, axis=0, method="lower"))
