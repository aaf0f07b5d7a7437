"""Workspace: the camera centre stays inside a box."""

from fractions import Fraction

from omniservo.verification.camera_path import CameraPath
from omniservo.verification.constraint import Constraint
from omniservo.verification.decision import Finding, nonnegative
from omniservo.verification.plan_file import Problem
from omniservo.verification.polynomials import minus


def workspace(problem: Problem) -> list[Constraint[CameraPath]]:
    """T ≥ min + margin and −t ≥ −max + margin, an axis each."""
    if problem.workspace is None:
        return []
    low, high = problem.workspace
    return [
        _wall(axis, side, sign, bound[axis])
        for axis in range(3)
        for side, sign, bound in (("min", 1, low), ("max", -1, high))
    ]


def _wall(axis: int, side: str, sign: int, bound: Fraction) -> Constraint[CameraPath]:
    def judge(margin: Fraction, path: CameraPath) -> Finding:
        coordinate = [sign * a for a in path.translation[axis]]
        return nonnegative(minus(coordinate, (sign * bound + margin) * path.scale))

    def left(path: CameraPath, w: Fraction) -> float:
        return float(sign * (path.position(w)[axis] - bound))

    return Constraint(f"workspace {'xyz'[axis]} {side}", "m", lambda m: lambda path: judge(m, path), left)
