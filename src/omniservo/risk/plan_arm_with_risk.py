"""A plan for the whole arm at a stated risk: estimate and camera mount are uncertain."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import numpy.typing as npt

from omniservo.estimation import TwoViewEstimate
from omniservo.geometry.arrays import FloatArray
from omniservo.planning.plan import Plan
from omniservo.planning.planning_problem import PlanningProblem
from omniservo.risk.executions import Executions
from omniservo.risk.link_margin import LEAST_SAMPLES, RARE, plan_links_at_risk
from omniservo.risk.plan_with_risk import followed_rows, plan_with_risk, problem_of_estimate
from omniservo.risk.risk_plan import LinkMargin, RiskPlan
from omniservo.whole_arm.arm_setting import ArmSetting
from omniservo.whole_arm.plan_with_arm import plan_with_arm

LINKS_PART = 0.5
"""of the risk: that a gap of the arm is too narrow. The rest is the camera's demands'."""


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

    The camera's demands are widened as there; of the arm's gaps see `plan_links_at_risk`. The two halves are
    added up (Boole), whatever mounts and estimates violate both. Where the setting asks for no clearance to
    obstacles the camera has all of the risk.

    Args:
        problem: see `plan_with_risk`.
        setting: see `plan_with_arm`.
        estimate: see `plan_with_risk`.
        risk: likewise.
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
    rows = followed_rows(estimate, points)
    links = LINKS_PART * risk
    count = max(LEAST_SAMPLES, math.ceil(RARE / links)) if 0.0 < links < 1.0 else LEAST_SAMPLES
    samples = estimate.sample(np.random.default_rng([seed, 3]), count, camera=problem.camera, rows=rows)
    executions = Executions.of(problem_of_estimate(problem, estimate, rows), samples)
    margins: list[tuple[Plan, LinkMargin]] = []

    def with_arm(asked: PlanningProblem, seed: int) -> Plan:
        found, margin = plan_links_at_risk(
            asked, setting, links, mount_covariance=mount_covariance, executions=executions, seed=seed
        )
        margins.append((found.plan, margin))
        return found.plan

    answer = plan_with_risk(problem, estimate, risk=risk - links, points=points, seed=seed, planner=with_arm)
    of_plan = [m for plan, m in margins if plan.path is not None and plan.path is answer.plan.path]
    return replace(answer, links=of_plan[-1] if of_plan else None)
