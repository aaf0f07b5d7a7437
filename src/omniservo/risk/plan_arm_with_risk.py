"""A plan for the whole arm at a stated risk: estimate and camera mount are uncertain."""

from __future__ import annotations

import time
from dataclasses import replace

import numpy.typing as npt

from omniservo.estimation import TwoViewEstimate
from omniservo.geometry.arrays import FloatArray, finite_number
from omniservo.planning.plan import Plan
from omniservo.planning.planning_problem import PlanningProblem
from omniservo.risk.link_margin import judged_links, missing_for_links, plan_links_at_risk
from omniservo.risk.plan_with_risk import (
    LEAST_RISK,
    MOST_RISK,
    followed_rows,
    plan_with_risk,
    problem_of_estimate,
    searched,
)
from omniservo.risk.risk_plan import LinkMargin, RiskPlan
from omniservo.risk.safe_path import STRICTER
from omniservo.risk.samples import RiskSamples
from omniservo.whole_arm.arm_plan import ArmPlan
from omniservo.whole_arm.arm_setting import ArmSetting
from omniservo.whole_arm.plan_with_arm import plan_with_arm

LINKS_PART = 0.5
"""of the risk: that a gap of the arm is too narrow. The rest is the camera's constraints'."""


def plan_arm_with_risk(
    problem: PlanningProblem,
    setting: ArmSetting,
    estimate: TwoViewEstimate,
    *,
    risk: float = 0.01,
    points: npt.ArrayLike | None = None,
    mount_covariance: FloatArray | None = None,
    seed: int = 0,
) -> RiskPlan:
    """Return what `plan_with_risk` does, for the whole arm; half of the risk is the links'.

    The camera's constraints are widened as there; the arm's gaps as `plan_links_at_risk` does, and judged by
    the samples that had no part in the search, as the camera's are. The two halves are added up (Boole),
    whatever mounts and estimates violate both. Where the setting asks for no clearance to obstacles the
    camera has all of the risk.

    Args:
        problem: see `plan_with_risk`.
        setting: see `plan_with_arm`.
        estimate: see `plan_with_risk`.
        risk: 0.0002 to 0.5, or as there where the camera has all of it.
        points: likewise.
        mount_covariance: see `plan_links_at_risk`.
        seed: of all samples, and of planning.

    Raises:
        InputError: see `plan_with_risk`, `plan_with_arm`, `plan_links_at_risk`.
    """
    if setting.clearance is None:
        return plan_with_risk(
            problem, estimate, risk=risk, points=points, seed=seed,
            planner=lambda asked, seed: plan_with_arm(asked, setting, seed=seed).plan,
        )  # fmt: skip
    begin = time.perf_counter()
    finite_number("risk", risk, minimum=LEAST_RISK / (1.0 - LINKS_PART), maximum=MOST_RISK)
    seed = int(finite_number("seed", seed, minimum=0))
    rows, links = followed_rows(estimate, points), LINKS_PART * risk
    samples = RiskSamples(problem_of_estimate(problem, estimate, rows), estimate, rows, risk - links, seed)
    planner = _LinksAtRisk(samples, setting, links, mount_covariance)
    answer = searched(samples, begin, planner.plan, planner.missing)
    return replace(answer, links=planner.margin_of(answer.found))


class _LinksAtRisk:
    """Plans whose gaps allow for what is uncertain; it begins with the clearance that it added last."""

    def __init__(
        self, samples: RiskSamples, setting: ArmSetting, risk: float, mount_covariance: FloatArray | None
    ) -> None:
        """Add nothing yet."""
        self._samples, self._setting, self._risk, self._mounts = samples, setting, risk, mount_covariance
        self._stricter, self._added = iter(STRICTER), 0.0
        self._draw, self._share = samples.draws[0], risk * next(self._stricter)
        self._found: list[tuple[ArmPlan, LinkMargin]] = []

    def plan(self, asked: PlanningProblem, seed: int) -> Plan:
        """Return a plan that the samples of the search allow."""
        found, margin = plan_links_at_risk(
            asked, self._setting, self._share,
            mount_covariance=self._mounts, draw=self._draw, seed=seed, begin=self._added,
        )  # fmt: skip
        if found.certified:
            self._added = margin.added
        self._found.append((found, margin))
        return found.plan

    def missing(self, plan: Plan) -> str:
        """Return what the gaps of a plan miss by samples that had no part in the search; "": nothing.

        What is planned from then on is searched with more samples, for less risk.
        """
        at = self._at(plan)
        if at is None or not self._found[at][0].certified:
            return ""
        found, searched_for = self._found[at]
        margin, needed = judged_links(
            found, self._setting, self._risk, self._mounts, self._samples.check, self._samples.seed + 1
        )
        self._found[at] = found, replace(margin, added=searched_for.added)
        if needed <= 0.0:
            return ""
        self._draw = self._samples.draws[-1]
        self._share = self._risk * next(self._stricter, STRICTER[-1])
        return missing_for_links(needed, searched_for.added)

    def margin_of(self, plan: Plan) -> LinkMargin | None:
        """Return what was found with a plan; None: it is none of these."""
        at = self._at(plan)
        return None if at is None else self._found[at][1]

    def _at(self, plan: Plan) -> int | None:
        paths = [found.plan.path for found, _ in self._found]
        same = [i for i, path in enumerate(paths) if path is not None and path is plan.path]
        return same[-1] if same else None
