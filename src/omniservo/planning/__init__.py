"""Certified camera paths: problem, constraints, search, certificate, plan."""

from omniservo.planning.box import Box
from omniservo.planning.camera_path import CameraPath
from omniservo.planning.capsule import Capsule
from omniservo.planning.certificate import Certificate, ConstraintMargin, Separator
from omniservo.planning.certify import certify
from omniservo.planning.cloud import Cloud
from omniservo.planning.half_space import HalfSpace
from omniservo.planning.improving_plans import improving_plans
from omniservo.planning.mesh import Mesh
from omniservo.planning.plan import Plan
from omniservo.planning.plan_path import plan_path
from omniservo.planning.planning_problem import Degrees, PlanningProblem, Workspace
from omniservo.planning.replan import replan
from omniservo.planning.sphere import Sphere

__all__ = [
    "Box",
    "CameraPath",
    "Capsule",
    "Certificate",
    "Cloud",
    "ConstraintMargin",
    "Degrees",
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
    "replan",
]
