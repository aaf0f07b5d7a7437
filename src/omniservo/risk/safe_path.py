"""The search for margins that are wide enough: plan, look at the samples, widen, plan again."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import lru_cache
from typing import NamedTuple, TypeAlias

import numpy as np
from scipy.special import betaincinv

from omniservo.errors import InputError
from omniservo.geometry.arrays import FloatArray, IntArray
from omniservo.planning.camera_path import CameraPath
from omniservo.planning.plan import Plan
from omniservo.planning.plan_path import plan_path
from omniservo.planning.planning_problem import PlanningProblem
from omniservo.planning.widened import widened
from omniservo.risk.checked_places import CheckedPlaces
from omniservo.risk.executions import IMAGE, Executions, constraints_of

STRICTER = (1.0, 0.75, 0.5)
"""Parts of the risk that are searched for, until samples that had no part in the search agree."""

CONFIDENCE = 0.95
"""of the bound on the share of violations, over all verdicts that may be given on the same samples"""

EACH = 1.0 - (1.0 - CONFIDENCE) / (2 * len(STRICTER))
"""of each of them (Bonferroni), on the camera's constraints and on the links' in each of the searches: one
that begins anew because of a verdict has learnt from its samples"""

ROUNDS = 8
"""of planning; two or three are usual"""

WORST = 16
"""So many times the violations that are allowed are kept of the worst samples of each constraint."""

WORTHWHILE = 0.5
"""Where the worst are a larger part of all samples, all are executed at once."""

AHEAD = 1.05
"""A margin is widened by this part of what was missing: the next path is another one."""

END_ROOM = 0.99
"""Part of what the end poses leave that may be required of the whole path."""


class RiskVerdict(NamedTuple):
    """What samples say of a plan."""

    ok: bool
    """few enough violate a constraint"""
    violations: int
    """so many do"""
    allowed: int
    """so many may"""
    executions: Executions
    """the samples that the verdict rests on"""
    places: CheckedPlaces
    """of the plan's path"""


@dataclass(frozen=True, eq=False)
class SafePath:
    """The best plan that was found, and whether its risk is as small as required."""

    ok: bool
    plan: Plan
    extra: FloatArray
    """(d,) what was added to each constraint [m], [px]"""
    verdict: RiskVerdict | None = None
    """of the plan's executions; None where there is no path"""


def upper_bound(violations: int, samples: int, repeats: float = 1.0) -> float:
    """Return the probability that so many violations in so many samples leave possible (Clopper-Pearson).

    With `EACH`, so that all verdicts on the same samples together have `CONFIDENCE`. Of samples that repeat
    motions (`EstimateSamples.repeats`) the same share of the effective sample size.
    """
    if violations >= samples:
        return 1.0
    return float(betaincinv(violations / repeats + 1, (samples - violations) / repeats, EACH))


@lru_cache(maxsize=64)
def allowed_violations(risk: float, samples: int, repeats: float = 1.0) -> int:
    """Return the most violations whose upper bound is within ``risk``; −1 where not even 0 is."""
    count = -1
    while count + 1 < samples and upper_bound(count + 1, samples, repeats) <= risk:
        count += 1
    return count


Planner: TypeAlias = Callable[[PlanningProblem, int], Plan]
"""From a problem and a seed to a plan."""

Draw: TypeAlias = Callable[[], Executions]
"""What gives samples when they are first needed, and the same ones from then on."""


def camera_alone(problem: PlanningProblem, seed: int) -> Plan:
    """Plan without an arm."""
    return plan_path(problem, seed=seed)


def safe_path(
    problem: PlanningProblem,
    draws: Sequence[Draw],
    risk: float,
    seed: int,
    planner: Planner = camera_alone,
    begin: FloatArray | None = None,
) -> SafePath:
    """Return a certified plan whose executions violate it with at most ``risk``, or the best attempt.

    Margins are only widened for what the samples jointly need, and by no more than the end poses leave.

    Args:
        problem: as the estimate has it.
        draws: samples to search with. Where the first ones already allow a plan the next are not drawn.
        risk: the bound on the share of violations among them.
        seed: of planning.
        planner: what plans.
        begin: what is added to each constraint at first (d,) [m], [px]; None: nothing.

    Raises:
        InputError: what planning refuses in the problem itself.
    """
    constraints = constraints_of(problem)
    extra = np.zeros(len(constraints)) if begin is None else begin
    proven, search = np.zeros(len(constraints)), _Search(draws, risk)
    best = SafePath(False, Plan(problem, "not_found", None, None, 0.0, "certified"), extra)
    for _ in range(ROUNDS):
        plan = _plan(problem, extra, seed, planner)
        if plan is None or plan.status != "certified" or plan.path is None:
            if best.plan.path is None and not extra.any():
                return replace(best, plan=plan or planner(problem, seed))
            if np.abs(extra - proven).max() < 1e-6:
                break
            extra = proven if best.plan.path is None else 0.5 * (extra + proven)
            continue
        verdict = search.judged(plan, plan.path)
        if verdict.ok:
            return SafePath(True, plan, extra, verdict)
        if best.verdict is None or verdict.violations <= best.verdict.violations:
            best = SafePath(False, plan, extra, verdict)
        proven, missed = extra, search.missed(verdict)
        room = END_ROOM * verdict.executions.planned(plan.path, np.array([0.0, 1.0]))
        extra = np.clip(extra + AHEAD * missed, 0.0, np.maximum(room, extra))
        if np.abs(extra - proven).max() < 1e-9:
            break
    return best


class _Search:
    """Samples that plans are judged by: at first the few, then all, from then on the worst of all first."""

    def __init__(self, draws: Sequence[Draw], risk: float) -> None:
        """Draw nothing yet."""
        self._few, self._every, self._risk = list(draws[:-1]), draws[-1], risk
        self._worst: Executions | None = None

    def judged(self, plan: Plan, path: CameraPath) -> RiskVerdict:
        """Return what the samples say of a plan.

        The worst alone can say that too many violate a constraint, but not that few enough do.
        """
        first = self._few[0] if self._few else self._every
        places = first().places(path, critical_places(plan))
        while self._few:
            few = self._few[0]()
            found = self._of(few, len(few.points), places)
            if found.ok:
                return found
            self._few.pop(0)
        every = self._every()
        if self._worst is not None:
            found = self._of(self._worst, len(every.points), places)
            if not found.ok:
                return found
        return self._of(every, len(every.points), places)

    def missed(self, verdict: RiskVerdict) -> FloatArray:
        """Return what each constraint misses (d,) by a verdict against a plan, and keep its worst samples."""
        margins, every = verdict.executions.margins_at(verdict.places), self._every()
        if verdict.executions is every:
            rows = worst_samples(margins, WORST * (verdict.allowed + 1))
            self._worst = every.of_samples(rows) if len(rows) < WORTHWHILE * len(every.points) else None
        return joint_shift(margins, verdict.allowed)

    def _of(self, executions: Executions, count: int, places: CheckedPlaces) -> RiskVerdict:
        """Return the verdict of samples out of so many."""
        violations = int(executions.violated_at(places).sum())
        allowed = allowed_violations(self._risk, count)
        return RiskVerdict(violations <= allowed, violations, allowed, executions, places)


def worst_samples(margins: FloatArray, count: int) -> IntArray:
    """Return the samples that have one of the ``count`` smallest margins of a constraint, margins (K, d)."""
    if count >= len(margins):
        return np.arange(len(margins))
    return np.unique(np.argpartition(margins, count - 1, axis=0)[:count])


def critical_places(plan: Plan) -> FloatArray:
    """Return where the certificate found its smallest margins (k,)."""
    if plan.certificate is None:
        return np.empty(0)
    return np.array([min(max(c.w, 0.0), 1.0) for c in plan.certificate.constraints])


def joint_shift(margins: FloatArray, allowed: int) -> FloatArray:
    """Return what each constraint misses (d,), < 0 to spare; at most ``allowed`` samples may violate any.

    Every constraint gives up equally many of its own worst samples, as many as go together: one region of the
    samples, and no sum of separate risks.
    """
    ordered = np.sort(margins, axis=0)
    for given_up in range(max(allowed, 0), -1, -1):
        shift = -ordered[given_up]
        if ((margins + shift) < 0.0).any(axis=1).sum() <= allowed:
            break
    return np.where(np.isfinite(shift), shift, 0.0)


def _plan(problem: PlanningProblem, extra: FloatArray, seed: int, planner: Planner) -> Plan | None:
    """Return the plan of the widened problem; None where nothing of image or workspace is left."""
    metres = dict(zip(constraints_of(problem), extra.tolist(), strict=True))
    try:
        return planner(widened(problem, metres, metres.pop(IMAGE)), seed)
    except InputError:
        return None
