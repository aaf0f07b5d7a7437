"""The independent, exact check of a plan file. Imports nothing else of ours."""

from omniservo.verification.certificate import Certificate, Judgement
from omniservo.verification.fields import PlanFileError
from omniservo.verification.problem_differences import Difference
from omniservo.verification.verify_plan import verify_plan

__all__ = ["Certificate", "Difference", "Judgement", "PlanFileError", "verify_plan"]
