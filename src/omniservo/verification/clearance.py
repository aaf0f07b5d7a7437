"""Clearance: the camera centre's distance from every obstacle, (26)–(28)."""

from fractions import Fraction
from math import sqrt

from omniservo.verification.camera_path import CameraPath
from omniservo.verification.constraint import Constraint
from omniservo.verification.decision import HOLDS, Finding, nonnegative
from omniservo.verification.enclosures import root_above, root_below
from omniservo.verification.plan_file import HalfSpace, Problem, Separators, Sphere
from omniservo.verification.polynomials import combine, integers, minus, value
from omniservo.verification.separation import body_clearance


def clearance(problem: Problem, separators: Separators) -> list[Constraint[CameraPath]]:
    """Return one constraint an obstacle, in the problem's order."""
    found = []
    for i, obstacle in enumerate(problem.obstacles):
        if isinstance(obstacle, Sphere):
            found.append(_from_sphere(i, obstacle))
        elif isinstance(obstacle, HalfSpace):
            found.append(free_side(f"clearance obstacle {i}", obstacle))
        else:
            found.append(body_clearance(i, obstacle, separators))
    return found


def _from_sphere(index: int, sphere: Sphere) -> Constraint[CameraPath]:
    """‖t − o‖² ≥ (radius + clearance + margin)²."""
    asked = sphere.radius + sphere.clearance

    def judge(margin: Fraction, path: CameraPath) -> Finding:
        bound = asked + margin
        if bound <= 0:
            return HOLDS
        return nonnegative(minus(path.distance_squared(sphere.center), (bound * path.scale) ** 2))

    def left(path: CameraPath, w: Fraction) -> float:
        squared = value(path.distance_squared(sphere.center), w) / path.scale**2
        return sqrt(squared) - float(asked)

    return Constraint(f"clearance obstacle {index}", "m", lambda m: lambda path: judge(m, path), left)


def free_side(name: str, solid: HalfSpace) -> Constraint[CameraPath]:
    """n·t ≥ (offset + clearance + margin)‖n‖."""
    asked = solid.offset + solid.clearance
    squared_length = sum((x * x for x in solid.normal), Fraction(0))

    def judge(margin: Fraction, path: CameraPath) -> Finding:
        bound = asked + margin
        bound *= root_above(squared_length) if bound > 0 else root_below(squared_length)
        *normal, least = integers(*solid.normal, bound * path.scale)
        return nonnegative(combine(*zip(normal, path.translation, strict=True), (-least, [1])))

    def left(path: CameraPath, w: Fraction) -> float:
        along = sum(n * x for n, x in zip(solid.normal, path.position(w), strict=True))
        return float(along) / sqrt(squared_length) - float(asked)

    return Constraint(name, "m", lambda m: lambda path: judge(m, path), left)
