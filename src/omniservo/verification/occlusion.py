"""Occlusion: no sphere, box or capsule stands between the camera centre and a target point."""

from fractions import Fraction
from math import sqrt

from omniservo.verification.camera_path import CameraPoint
from omniservo.verification.constraint import Constraint
from omniservo.verification.decision import HOLDS, Finding, decide
from omniservo.verification.plan_file import HalfSpace, Problem, Separators, Sphere
from omniservo.verification.polynomials import combine, minus, squares, times
from omniservo.verification.separation import body_occlusion


def occlusion(problem: Problem, separators: Separators) -> list[Constraint[CameraPoint]]:
    """Return one constraint for each box, capsule and sphere with a radius, where the problem asks for it.

    A half-space hides no point in front of it: what is free is convex.
    """
    found = []
    for i, obstacle in enumerate(problem.obstacles if problem.occlusion else ()):
        if isinstance(obstacle, Sphere):
            found += [_by_sphere(i, obstacle)] if obstacle.radius > 0 else []
        elif not isinstance(obstacle, HalfSpace):
            found.append(body_occlusion(i, obstacle, separators))
    return found


def _by_sphere(index: int, sphere: Sphere) -> Constraint[CameraPoint]:
    """‖p + λ(q − p)‖ ≥ R for λ in [0, 1], with p = t − o, q = h − o and R = radius + margin.

    That is a(1−λ)² + 2bλ(1−λ) + cλ² ≥ 0 with a = ‖p‖² − R², b = p·q − R², c = ‖q‖² − R², which holds
    for all λ exactly where a ≥ 0 and c ≥ 0 and (b ≥ 0 or ac ≥ b²).
    """

    def judge(margin: Fraction, point: CameraPoint) -> Finding:
        radius = sphere.radius + margin
        if radius <= 0:
            return HOLDS
        bound = (radius * point.path.scale) ** 2
        p, q = point.path.offsets(sphere.center), _away(point, sphere)
        a, c = minus(squares(*p), bound), minus([sum(x * x for x in q)], bound)
        b = minus(combine(*zip(q, p, strict=True)), bound)
        return decide([a, b, c, combine((1, times(a, c)), (-1, squares(b)))], [(0, 2, 1), (0, 2, 3)])

    def left(point: CameraPoint, w: Fraction) -> float:
        h = [float(x - o) for x, o in zip(point.point, sphere.center, strict=True)]
        t = [float(x - o) for x, o in zip(point.path.position(w), sphere.center, strict=True)]
        along = [x - y for x, y in zip(h, t, strict=True)]
        length = sum(x * x for x in along)
        share = -sum(x * y for x, y in zip(t, along, strict=True)) / length if length > 0 else 0.0
        share = min(1.0, max(0.0, share))
        nearest = sum((x + share * y) ** 2 for x, y in zip(t, along, strict=True))
        return sqrt(nearest) - float(sphere.radius)

    return Constraint(f"occlusion obstacle {index}", "m", lambda m: lambda point: judge(m, point), left)


def _away(point: CameraPoint, sphere: Sphere) -> list[int]:
    """(h − o)·scale."""
    return [int((x - o) * point.path.scale) for x, o in zip(point.point, sphere.center, strict=True)]
