"""Masks: target points stay out of convex polygons of the image."""

from fractions import Fraction
from math import hypot, inf

from omniservo.verification.camera_path import CameraPoint
from omniservo.verification.constraint import Constraint, Judge
from omniservo.verification.decision import HOLDS, Finding, decide
from omniservo.verification.enclosures import root_above, root_below
from omniservo.verification.fields import Vector
from omniservo.verification.image_limits import Line
from omniservo.verification.pixels import combine_sums, distorted, pixel
from omniservo.verification.plan_file import Camera, Problem
from omniservo.verification.polynomials import Polynomial, bernstein, combine, integers, squares, times


def masks(problem: Problem) -> list[Constraint[CameraPoint]]:
    """Return one constraint a polygon."""
    return [_mask(problem, i, corners) for i, corners in enumerate(problem.camera.mask)]


def _mask(problem: Problem, index: int, corners: tuple[Vector, ...]) -> Constraint[CameraPoint]:
    """Beyond one edge of the polygon, each moved outward by visibility margin + margin."""
    camera, lines = problem.camera, _edges(corners)

    def judge(margin: Fraction) -> Judge[CameraPoint]:
        asked = problem.visibility_margin + margin
        moved = [(l1, l2, l3 - _outward(l1 * l1 + l2 * l2, asked)) for l1, l2, l3 in lines]
        if any(camera.distortion):
            return lambda point: _distorted_beyond_one(point, camera, moved)
        cones = []
        for l1, l2, l3 in moved:
            d = l1 * camera.cx + l2 * camera.cy + l3
            cones.append(integers(l1 * camera.fx, l1 * camera.skew + l2 * camera.fy, d, d * camera.xi))
        return lambda point: _beyond_one(point, cones)

    def left(point: CameraPoint, w: Fraction) -> float:
        at = pixel(point, camera, w)
        if at is None:
            return -inf
        u, v = map(Fraction, at)
        beyond = max(float(l1 * u + l2 * v + l3) / hypot(l1, l2) for l1, l2, l3 in lines)
        return beyond - float(problem.visibility_margin)

    return Constraint(f"visibility mask {index}", "px", judge, left)


def _distorted_beyond_one(point: CameraPoint, camera: Camera, lines: list[Line]) -> Finding:
    """Decide whether at every w the distorted pixel is beyond at least one line.

    Times D⁵ that is a + bρ ≥ 0: a ≥ 0 and b ≥ 0, or a ≥ 0 and a² ≥ b²q, or b ≥ 0 and b²q ≥ a².
    """
    x, y, d = distorted(point, camera)
    polynomials: list[Polynomial] = []
    branches: list[tuple[int, ...]] = []
    for l1, l2, l3 in lines:
        weights = integers(
            l1 * camera.fx, l1 * camera.skew + l2 * camera.fy, l1 * camera.cx + l2 * camera.cy + l3
        )
        a, b = combine_sums(*zip(weights, (x, y, d), strict=True))
        if min(bernstein(a)) >= 0 and min(bernstein(b)) >= 0:
            return HOLDS
        first, g = len(polynomials), combine((1, squares(a)), (-1, times(squares(b), point.q)))
        polynomials += [a, b, g, [-c for c in g]]
        branches += [(first, first + 1), (first, first + 2), (first + 1, first + 3)]
    return decide(polynomials, branches)


def _edges(corners: tuple[Vector, ...]) -> list[Line]:
    """Return (l₁, l₂, l₃) of each edge: l₁u + l₂v + l₃ ≥ 0 beyond it, outside the polygon."""
    (ax, ay), (bx, by), (cx, cy) = corners[:3]
    turn = 1 if (bx - ax) * (cy - ay) > (by - ay) * (cx - ax) else -1
    lines = []
    for (x, y), (u, v) in zip(corners, (*corners[1:], corners[0]), strict=True):
        l1, l2 = turn * (v - y), turn * (x - u)
        lines.append((l1, l2, -(l1 * x + l2 * y)))
    return lines


def _outward(squared_length: Fraction, distance: Fraction) -> Fraction:
    """Return a number ≥ distance·√(squared length)."""
    return distance * (root_above(squared_length) if distance > 0 else root_below(squared_length))


def _beyond_one(point: CameraPoint, cones: list[list[int]]) -> Finding:
    """Decide whether at every w aX + bY + dZ + kρ ≥ 0 for at least one edge (a, b, d, k).

    With e = aX + bY + dZ and g = e² − k²q that is, for k ≥ 0, e ≥ 0 or g ≤ 0; for k < 0, e ≥ 0 and g ≥ 0.
    """
    polynomials: list[Polynomial] = []
    branches: list[tuple[int, ...]] = []
    for a, b, d, k in cones:
        e = combine((a, point.x), (b, point.y), (d, point.z))
        if k >= 0 and min(bernstein(e)) >= 0:
            return HOLDS
        first, g = len(polynomials), combine((1, squares(e)), (-k * k, point.q))
        polynomials += [e, g if k < 0 else [-c for c in g]]
        branches += [(first, first + 1)] if k < 0 else [(first,), (first + 1,)]
    return decide(polynomials, branches)
