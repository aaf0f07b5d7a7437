"""Dead zone: target points stay outside a disc of the image."""

from fractions import Fraction
from math import hypot, inf

from omniservo.verification.camera_path import CameraPoint
from omniservo.verification.constraint import Constraint
from omniservo.verification.decision import HOLDS, Finding, root_sum
from omniservo.verification.pixels import combine_sums, distorted, pixel, times_sums
from omniservo.verification.plan_file import Problem
from omniservo.verification.polynomials import integers


def dead_zone(problem: Problem) -> list[Constraint[CameraPoint]]:
    """(u − u₀)² + (v − v₀)² ≥ (radius + visibility margin + margin)², times d², as a + bρ ≥ 0."""
    camera = problem.camera
    if camera.dead_zone is None:
        return []
    u0, v0, radius = camera.dead_zone
    asked = radius + problem.visibility_margin

    def judge(margin: Fraction, point: CameraPoint) -> Finding:
        if asked + margin <= 0:
            return HOLDS
        fx, skew, cu, fy, cv, r = integers(
            camera.fx, camera.skew, camera.cx - u0, camera.fy, camera.cy - v0, asked + margin
        )
        x, y, d = distorted(point, camera)
        u, v = combine_sums((fx, x), (skew, y), (cu, d)), combine_sums((fy, y), (cv, d))
        squared = [(1, times_sums(u, u, point.q)), (1, times_sums(v, v, point.q))]
        return root_sum(*combine_sums(*squared, (-r * r, times_sums(d, d, point.q))), point.q)

    def left(point: CameraPoint, w: Fraction) -> float:
        at = pixel(point, camera, w)
        return inf if at is None else hypot(at[0] - float(u0), at[1] - float(v0)) - float(asked)

    return [Constraint("dead_zone", "px", lambda m: lambda point: judge(m, point), left)]
