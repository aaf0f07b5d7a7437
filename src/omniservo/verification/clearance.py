"""Clearance: the camera centre's distance from every obstacle, (26)–(28)."""

from fractions import Fraction
from math import sqrt

from omniservo.verification.camera_path import CameraPath
from omniservo.verification.cloud import cloud_clearance
from omniservo.verification.constraint import Constraint
from omniservo.verification.decision import HOLDS, Finding, nonnegative
from omniservo.verification.enclosures import root_above, root_below
from omniservo.verification.motion import relative, unit_of
from omniservo.verification.obstacles import Cloud, HalfSpace, Sphere
from omniservo.verification.plan_file import Problem, Separators
from omniservo.verification.polynomials import combine, integers
from omniservo.verification.separation import body_clearance
from omniservo.verification.sphere import far_from_ball


def clearance(problem: Problem, separators: Separators) -> list[Constraint[CameraPath]]:
    """Return one constraint an obstacle, in the problem's order."""
    found = []
    for i, obstacle in enumerate(problem.obstacles):
        if isinstance(obstacle, Sphere):
            found.append(_from_sphere(i, obstacle))
        elif isinstance(obstacle, HalfSpace):
            found.append(free_side(f"clearance obstacle {i}", obstacle))
        elif isinstance(obstacle, Cloud):
            found.append(cloud_clearance(i, obstacle))
        else:
            found.append(body_clearance(i, obstacle, separators))
    return found


def _from_sphere(index: int, sphere: Sphere) -> Constraint[CameraPath]:
    """‖t − m − o‖² ≥ (radius + clearance + margin)²."""
    asked = sphere.radius + sphere.clearance

    def judge(margin: Fraction, path: CameraPath) -> Finding:
        if asked + margin <= 0:
            return HOLDS
        seen = relative(path, sphere.motion, unit=unit_of(sphere.center))
        return far_from_ball(seen, sphere.center, asked + margin)

    def left(path: CameraPath, w: Fraction) -> float:
        away = zip(relative(path, sphere.motion).camera_at(w), sphere.center, strict=True)
        return sqrt(sum((a - b) ** 2 for a, b in away)) - float(asked)

    return Constraint(f"clearance obstacle {index}", "m", lambda m: lambda path: judge(m, path), left)


def free_side(name: str, solid: HalfSpace) -> Constraint[CameraPath]:
    """n·(t − m) ≥ (offset + clearance + margin)‖n‖."""
    asked = solid.offset + solid.clearance
    squared_length = sum((x * x for x in solid.normal), Fraction(0))

    def judge(margin: Fraction, path: CameraPath) -> Finding:
        bound = asked + margin
        bound *= root_above(squared_length) if bound > 0 else root_below(squared_length)
        seen = relative(path, solid.motion)
        *normal, least = integers(*solid.normal, bound * seen.scale)
        return nonnegative(combine(*zip(normal, seen.camera, strict=True), (-least, [1])))

    def left(path: CameraPath, w: Fraction) -> float:
        at = relative(path, solid.motion).camera_at(w)
        along = sum(n * x for n, x in zip(solid.normal, at, strict=True))
        return float(along) / sqrt(squared_length) - float(asked)

    return Constraint(name, "m", lambda m: lambda path: judge(m, path), left)
