"""Plans that an uncertain estimate may be trusted with, at a stated risk (chance constraints)."""

from omniservo.risk.executions import Executions
from omniservo.risk.link_margin import plan_links_at_risk
from omniservo.risk.plan_arm_with_risk import plan_arm_with_risk
from omniservo.risk.plan_with_risk import plan_with_risk
from omniservo.risk.problem_around import problem_around
from omniservo.risk.risk_plan import LinkMargin, RiskPlan, UncertainMargin

__all__ = [
    "Executions",
    "LinkMargin",
    "RiskPlan",
    "UncertainMargin",
    "plan_arm_with_risk",
    "plan_links_at_risk",
    "plan_with_risk",
    "problem_around",
]
