"""Occlusion: no obstacle stands between the camera centre and a target point."""

from fractions import Fraction

from omniservo.verification.camera_path import CameraPoint
from omniservo.verification.cloud import cloud_occlusion
from omniservo.verification.constraint import Constraint
from omniservo.verification.decision import HOLDS, Finding
from omniservo.verification.motion import relative, unit_of
from omniservo.verification.obstacles import Cloud, HalfSpace, Sphere
from omniservo.verification.plan_file import Problem, Separators
from omniservo.verification.separation import body_occlusion
from omniservo.verification.sphere import sight_clear_of_ball, to_sight


def occlusion(problem: Problem, separators: Separators) -> list[Constraint[CameraPoint]]:
    """Return one constraint for each obstacle that can hide a point, where the problem asks for it.

    A sphere or cloud of radius 0 hides nothing. Nor does a half-space hide a point in front of it: what is
    free is convex.
    """
    found = []
    for i, obstacle in enumerate(problem.obstacles if problem.occlusion else ()):
        if isinstance(obstacle, Sphere):
            found += [_by_sphere(i, obstacle)] if obstacle.radius > 0 else []
        elif isinstance(obstacle, Cloud):
            found += [cloud_occlusion(i, obstacle)] if obstacle.radius > 0 else []
        elif not isinstance(obstacle, HalfSpace):
            found.append(body_occlusion(i, obstacle, separators))
    return found


def _by_sphere(index: int, sphere: Sphere) -> Constraint[CameraPoint]:
    """Every line of sight keeps radius + margin from the centre."""

    def judge(margin: Fraction, point: CameraPoint) -> Finding:
        radius = sphere.radius + margin
        if radius <= 0:
            return HOLDS
        seen = relative(point.path, sphere.motion, unit=unit_of(sphere.center), target=point.point)
        return sight_clear_of_ball(seen, sphere.center, radius)

    def left(point: CameraPoint, w: Fraction) -> float:
        seen = relative(point.path, sphere.motion, target=point.point)
        ends = ([float(x) for x in seen.camera_at(w)], [float(x) for x in seen.target_at(w)])
        return to_sight(*ends, [float(x) for x in sphere.center]) - float(sphere.radius)

    return Constraint(f"occlusion obstacle {index}", "m", lambda m: lambda point: judge(m, point), left)
