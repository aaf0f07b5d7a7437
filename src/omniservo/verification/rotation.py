"""Rotation: the quaternion stays away from 0, so that the path is a path of rotations."""

from fractions import Fraction

from omniservo.verification.camera_path import CameraPath
from omniservo.verification.constraint import Constraint
from omniservo.verification.decision import Finding, nonnegative
from omniservo.verification.plan_file import Problem
from omniservo.verification.polynomials import minus, squares, value

LEAST = Fraction(1, 100)


def rotation(_problem: Problem) -> list[Constraint[CameraPath]]:
    """‖φ‖² ≥ 0.01 + margin."""

    def judge(margin: Fraction, path: CameraPath) -> Finding:
        return nonnegative(minus(squares(*path.rotation), (LEAST + margin) * path.turn_scale**2))

    def left(path: CameraPath, w: Fraction) -> float:
        return float(value(squares(*path.rotation), w) / path.turn_scale**2 - LEAST)

    return [Constraint("rotation", "1", lambda m: lambda path: judge(m, path), left)]
