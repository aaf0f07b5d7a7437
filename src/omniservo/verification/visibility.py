"""Visibility: image edges, the circle of the largest angle; under distortion the polygon in their place."""

from fractions import Fraction
from math import hypot, inf

from omniservo.verification.camera_path import CameraPoint
from omniservo.verification.constraint import Constraint, Judge
from omniservo.verification.decision import HOLDS, Finding, root_sum
from omniservo.verification.distorted_region import anticlockwise, region
from omniservo.verification.enclosures import root_above, rounded_up
from omniservo.verification.fields import Vector
from omniservo.verification.image_limits import circle_radius, edges, least_stretch
from omniservo.verification.pixels import combine_sums, distorted, pixel
from omniservo.verification.plan_file import Problem
from omniservo.verification.polynomials import combine, integers

_NOTHING_LEFT = Finding("violated", Fraction(0))


def visibility(problem: Problem, polygon: tuple[Vector, ...] | None) -> list[Constraint[CameraPoint]]:
    """Return the limits of an image without distortion, or the one polygon that the plan states.

    Without a polygon the edges of a distorted image are judged as they are: exact, but slow, and blind to a
    distortion that folds back; enough to show that an end pose is wrong.
    """
    if any(problem.camera.distortion) and polygon is not None:
        return [_polygon(problem, polygon)]
    limits = [_edge(problem, name) for name in edges(problem.camera, Fraction(0))]
    return limits if problem.camera.max_angle is None else [*limits, _circle(problem)]


def _cone(point: CameraPoint, a: int, b: int, d: int, k: int) -> Finding:
    """AX + bY + dZ + kρ ≥ 0: a half-plane of the normalised plane."""
    return root_sum(combine((a, point.x), (b, point.y), (d, point.z)), [k], point.q)


def _edge(problem: Problem, name: str) -> Constraint[CameraPoint]:
    """l₁u + l₂v + l₃ ≥ 0, through K a half-plane of the normalised plane, times Z + ξρ."""
    camera = problem.camera

    def judge(margin: Fraction) -> Judge[CameraPoint]:
        l1, l2, l3 = edges(camera, problem.visibility_margin + margin)[name]
        line = (l1 * camera.fx, l1 * camera.skew + l2 * camera.fy, l1 * camera.cx + l2 * camera.cy + l3)
        if not any(camera.distortion):
            cone = integers(*line, line[2] * camera.xi)
            return lambda point: _cone(point, *cone)
        weights = integers(*line)
        return lambda point: root_sum(
            *combine_sums(*zip(weights, distorted(point, camera), strict=True)), point.q
        )

    def left(point: CameraPoint, w: Fraction) -> float:
        at = pixel(point, camera, w)
        l1, l2, l3 = map(float, edges(camera, problem.visibility_margin)[name])
        return -inf if at is None else l1 * at[0] + l2 * at[1] + l3

    return Constraint(f"visibility {name}", "px", judge, left)


def _circle(problem: Problem) -> Constraint[CameraPoint]:
    """‖m̄‖ ≤ r, that is Z ≥ cos θ ρ with cos θ = (ξ + √(1 + (1−ξ²)r²))/(1 + r²) − ξ, rounded up."""
    camera = problem.camera

    def judge(margin: Fraction) -> Judge[CameraPoint]:
        r = circle_radius(camera, problem.visibility_margin + margin)
        if r is None:
            return lambda _: HOLDS
        radicand = 1 + (1 - camera.xi**2) * r * r
        if r < 0 or radicand < 0:
            return lambda _: _NOTHING_LEFT if r < 0 else HOLDS
        cosine = rounded_up((camera.xi + root_above(radicand)) / (1 + r * r) - camera.xi)
        return lambda point: _cone(point, 0, 0, cosine.denominator, -cosine.numerator)

    def left(point: CameraPoint, w: Fraction) -> float:
        radius = circle_radius(camera, problem.visibility_margin)
        x, y, z, rho = point.coordinates(w)
        d = z + float(camera.xi) * rho
        if radius is None or d <= 0:
            return inf if radius is None else -inf
        return (float(radius) - hypot(x, y) / d) * float(least_stretch(camera)[0])

    return Constraint("visibility max_angle", "px", judge, left)


def _polygon(problem: Problem, polygon: tuple[Vector, ...]) -> Constraint[CameraPoint]:
    """The polygon lies in the region, and the point in the polygon: ax + by ≤ e is aX + bY ≤ e(Z + ξρ)."""
    camera = problem.camera

    def judge(margin: Fraction) -> Judge[CameraPoint]:
        found = region(camera, polygon, problem.visibility_margin + margin)
        if found.verdict != "holds":
            return lambda _: found
        vertices = anticlockwise(polygon) or polygon
        cones = [_side(vertices[i - 1], vertices[i], camera.xi) for i in range(len(vertices))]
        return lambda point: next(
            (f for f in (_cone(point, *c) for c in cones) if f.verdict != "holds"), HOLDS
        )

    def left(point: CameraPoint, w: Fraction) -> float:
        return min(
            edge.left(point, w) for edge in (_edge(problem, name) for name in edges(camera, Fraction(0)))
        )

    return Constraint("visibility polygon", "px", judge, left)


def _side(start: Vector, end: Vector, xi: Fraction) -> list[int]:
    """What lies to the left of a side, as the four integers of a cone."""
    a, b = start[1] - end[1], end[0] - start[0]
    d = -(a * start[0] + b * start[1])
    return integers(a, b, d, d * xi)
