"""Certified camera paths: problem, constraints, search, certificate, plan."""

from omniservo.planning.camera_path import CameraPath
from omniservo.planning.certificate.certificate import Certificate, ConstraintMargin, Separator
from omniservo.planning.certificate.certify import certify
from omniservo.planning.degrees import Degrees
from omniservo.planning.improving_plans import improving_plans
from omniservo.planning.obstacles.box import Box
from omniservo.planning.obstacles.capsule import Capsule
from omniservo.planning.obstacles.cloud import Cloud
from omniservo.planning.obstacles.cylinder import Cylinder
from omniservo.planning.obstacles.ellipsoid import Ellipsoid
from omniservo.planning.obstacles.half_space import HalfSpace
from omniservo.planning.obstacles.mesh import Mesh
from omniservo.planning.obstacles.sphere import Sphere
from omniservo.planning.plan import Plan
from omniservo.planning.plan_path import plan_path
from omniservo.planning.planning_problem import PlanningProblem
from omniservo.planning.widened import widened_evenly
from omniservo.planning.workspace import Workspace
from omniservo.planning.worst_moment import worst_moment
from omniservo.renamed import renamed

__all__ = [
    "Box",
    "CameraPath",
    "Capsule",
    "Certificate",
    "Cloud",
    "ConstraintMargin",
    "Cylinder",
    "Degrees",
    "Ellipsoid",
    "HalfSpace",
    "Mesh",
    "Plan",
    "PlanningProblem",
    "Separator",
    "Sphere",
    "Workspace",
    "certify",
    "improving_plans",
    "plan_path",
    "widened_evenly",
    "worst_moment",
]

__getattr__ = renamed(
    __name__,
    {
        "ArmPlan": "omniservo.whole_arm.ArmPlan",
        "ArmSetting": "omniservo.whole_arm.ArmSetting",
        "Executions": "omniservo.risk.Executions",
        "LinkMargin": "omniservo.risk.LinkMargin",
        "RiskPlan": "omniservo.risk.RiskPlan",
        "UncertainMargin": "omniservo.risk.UncertainMargin",
        "plan_arm_with_risk": "omniservo.risk.plan_arm_with_risk",
        "plan_links_at_risk": "omniservo.risk.plan_links_at_risk",
        "plan_with_arm": "omniservo.whole_arm.plan_with_arm",
        "plan_with_risk": "omniservo.risk.plan_with_risk",
        "problem_around": "omniservo.risk.problem_around",
        "replan": "omniservo.replanning.replan",
        "replan_with_arm": "omniservo.replanning.replan_with_arm",
    },
)
