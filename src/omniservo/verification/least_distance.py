"""Least distance: the camera centre never meets a target point, where every cone would read 0 ≤ 0."""

from fractions import Fraction
from math import sqrt

from omniservo.verification.camera_path import CameraPoint
from omniservo.verification.constraint import Constraint
from omniservo.verification.decision import HOLDS, Finding, nonnegative
from omniservo.verification.plan_file import Problem
from omniservo.verification.polynomials import minus, value


def least_distance(problem: Problem) -> list[Constraint[CameraPoint]]:
    """‖h − t‖² ≥ (least distance + margin)²."""

    def judge(margin: Fraction, point: CameraPoint) -> Finding:
        bound = problem.least_distance + margin
        return (
            HOLDS
            if bound <= 0
            else nonnegative(minus(point.distance_squared, (bound * point.path.scale) ** 2))
        )

    def left(point: CameraPoint, w: Fraction) -> float:
        squared = value(point.distance_squared, w) / point.path.scale**2
        return sqrt(squared) - float(problem.least_distance)

    return [Constraint("least_distance", "m", lambda m: lambda point: judge(m, point), left)]
