"""Certified camera paths: problem, constraints, search, certificate, plan."""

from omniservo.planning.camera_path import CameraPath
from omniservo.planning.certificate.certificate import Certificate, ConstraintMargin, Separator
from omniservo.planning.certificate.certify import certify
from omniservo.planning.improving_plans import improving_plans
from omniservo.planning.obstacles.box import Box
from omniservo.planning.obstacles.capsule import Capsule
from omniservo.planning.obstacles.cloud import Cloud
from omniservo.planning.obstacles.half_space import HalfSpace
from omniservo.planning.obstacles.mesh import Mesh
from omniservo.planning.obstacles.sphere import Sphere
from omniservo.planning.plan import Plan
from omniservo.planning.plan_path import plan_path
from omniservo.planning.planning_problem import Degrees, PlanningProblem, Workspace
from omniservo.planning.replan import replan
from omniservo.planning.risk.executions import Executions
from omniservo.planning.risk.plan_with_risk import plan_with_risk
from omniservo.planning.risk.problem_around import problem_around
from omniservo.planning.risk.risk_plan import LinkMargin, RiskPlan, UncertainMargin
from omniservo.planning.widened import widened_evenly
from omniservo.planning.with_arm.arm_plan import ArmPlan
from omniservo.planning.with_arm.arm_setting import ArmSetting
from omniservo.planning.with_arm.link_margin import plan_links_at_risk
from omniservo.planning.with_arm.plan_arm_with_risk import plan_arm_with_risk
from omniservo.planning.with_arm.plan_with_arm import plan_with_arm
from omniservo.planning.with_arm.replan_with_arm import replan_with_arm
from omniservo.planning.worst_moment import worst_moment

__all__ = [
    "ArmPlan",
    "ArmSetting",
    "Box",
    "CameraPath",
    "Capsule",
    "Certificate",
    "Cloud",
    "ConstraintMargin",
    "Degrees",
    "Executions",
    "HalfSpace",
    "LinkMargin",
    "Mesh",
    "Plan",
    "PlanningProblem",
    "RiskPlan",
    "Separator",
    "Sphere",
    "UncertainMargin",
    "Workspace",
    "certify",
    "improving_plans",
    "plan_arm_with_risk",
    "plan_links_at_risk",
    "plan_path",
    "plan_with_arm",
    "plan_with_risk",
    "problem_around",
    "replan",
    "replan_with_arm",
    "widened_evenly",
    "worst_moment",
]
