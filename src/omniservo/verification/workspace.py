"""Workspace: the camera centre stays inside a box, and on the free side of half-spaces."""

from fractions import Fraction

from omniservo.verification.camera_path import CameraPath
from omniservo.verification.clearance import free_side
from omniservo.verification.constraint import Constraint
from omniservo.verification.decision import Finding, nonnegative
from omniservo.verification.plan_file import Problem
from omniservo.verification.polynomials import minus


def workspace(problem: Problem) -> list[Constraint[CameraPath]]:
    """T ≥ min + margin and −t ≥ −max + margin, an axis each; n·t ≥ (offset + margin)‖n‖."""
    walls = [
        _wall(axis, side, sign, bound[axis])
        for axis in range(3)
        for side, sign, bound in zip(("min", "max"), (1, -1), problem.workspace or (), strict=False)
    ]
    sides = enumerate(problem.workspace_half_spaces)
    return walls + [free_side(f"workspace half-space {i}", side) for i, side in sides]


def _wall(axis: int, side: str, sign: int, bound: Fraction) -> Constraint[CameraPath]:
    def judge(margin: Fraction, path: CameraPath) -> Finding:
        coordinate = [sign * a for a in path.translation[axis]]
        return nonnegative(minus(coordinate, (sign * bound + margin) * path.scale))

    def left(path: CameraPath, w: Fraction) -> float:
        return float(sign * (path.position(w)[axis] - bound))

    return Constraint(f"workspace {'xyz'[axis]} {side}", "m", lambda m: lambda path: judge(m, path), left)
