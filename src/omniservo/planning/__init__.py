"""Certified camera paths: problem, constraints, search, certificate, plan."""

from omniservo.planning.camera_path import CameraPath
from omniservo.planning.certificate import Certificate, ConstraintMargin
from omniservo.planning.certify import certify
from omniservo.planning.plan import Plan
from omniservo.planning.plan_path import plan_path
from omniservo.planning.planning_problem import Degrees, PlanningProblem, Workspace
from omniservo.planning.sphere import Sphere

__all__ = [
    "CameraPath",
    "Certificate",
    "ConstraintMargin",
    "Degrees",
    "Plan",
    "PlanningProblem",
    "Sphere",
    "Workspace",
    "certify",
    "plan_path",
]
