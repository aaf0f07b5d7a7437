"""The polygon of a distorted camera: proven to lie inside the image before a point is proven to lie in it.

1. The polygon is convex.
2. The distortion's Jacobian is symmetric, and I on the axis. Its determinant is positive everywhere on the
   hull of polygon and axis, so it is positive definite there, and the distortion is one-to-one. The triangles
   (axis, vertex, next vertex) cover that hull, wherever the axis lies.
3. Such a map takes inner points to inner points, so u and v take their extremes on the outline: it is enough
   that the outline stays inside the image's edges.
4. The circles are convex: it is enough that they contain the vertices. Moving by dr along the plane
   moves the pixel by at least σ_min λ(r) dr, with λ(r) ≤ the Jacobian's eigenvalues at radius r.
"""

from fractions import Fraction
from itertools import combinations

from omniservo.verification.decision import HOLDS, Finding, nonnegative
from omniservo.verification.enclosures import root_above
from omniservo.verification.fields import Vector
from omniservo.verification.image_limits import circle_radius, edges, least_stretch
from omniservo.verification.pixels import combine_sums, distort
from omniservo.verification.plan_file import Camera
from omniservo.verification.polynomials import integers
from omniservo.verification.work import bits, products, spend, spend_on_fractions

_MOST_TRIANGLES = 20_000
_RINGS = 64
Corner = tuple[int, int]
Triangle = tuple[Corner, Corner, Corner]
Form = dict[int, int]
"""A form in barycentric coordinates: the coefficient of λ₀ⁿ⁻ⁱ⁻ʲ λ₁ⁱ λ₂ʲ stands at 16i + j."""


def anticlockwise(polygon: tuple[Vector, ...]) -> tuple[Vector, ...] | None:
    """Return the vertices with the polygon to the left of every side; None where it is not convex."""
    n = len(polygon)
    area = sum((_cross(polygon[i - 1], polygon[i]) for i in range(n)), Fraction(0))
    vertices = polygon if area > 0 else polygon[::-1]
    flat = integers(*(x for vertex in vertices for x in vertex))
    corners = list(zip(flat[::2], flat[1::2], strict=True))
    spend(products(16 * n * n, bits(flat), bits(flat)))
    for i in range(n):
        (x0, y0), (x1, y1) = corners[i - 1], corners[i]
        dx, dy = x1 - x0, y1 - y0
        if any(dx * (y - y0) < dy * (x - x0) for x, y in corners):
            return None
    return vertices if area != 0 else None


def region(camera: Camera, polygon: tuple[Vector, ...], inset: Fraction) -> Finding:
    """Decide whether the distorted polygon lies in the image, ``inset`` px inside its limits, one-to-one."""
    vertices = anticlockwise(polygon)
    if vertices is None:
        return Finding("violated", None, "the polygon is not convex")
    found = _inside_circles(camera, vertices, inset)
    if found is not None:
        return found
    scaled = integers(Fraction(1), *(x for vertex in vertices for x in vertex))
    one, corners = scaled[0], list(zip(scaled[1::2], scaled[2::2], strict=True))
    return _one_to_one(camera, one, corners) or _outline_inside(camera, one, corners, inset) or HOLDS


def _inside_circles(camera: Camera, vertices: tuple[Vector, ...], inset: Fraction) -> Finding | None:
    """Return what is wrong with the vertices' largest radius: the domain, and the circle of max_angle."""
    squared = max(x * x + y * y for x, y in vertices)
    if camera.xi > 1 and (camera.xi**2 - 1) * squared >= 1:
        return Finding("violated", None, "the polygon leaves the model's domain")
    outer, inner = circle_radius(camera, Fraction(0)), root_above(squared)
    if outer is None:
        return None
    if inner > outer:
        return Finding("violated", None, "the polygon leaves the circle of max_angle")
    if _pixels_between(camera, inner, outer) >= inset or _folded(camera, outer):
        return None
    return Finding("violated", None, "the polygon comes too close to the circle of max_angle")


def _eigenvalues(camera: Camera, radius: Fraction, reach: Fraction) -> tuple[Fraction, Fraction]:
    """Return bounds of the Jacobian's eigenvalues on the ring from ``radius`` to ``reach``, the least one's.

    Radially 1 + 3k₁r² + 5k₂r⁴, across 1 + k₁r² + k₂r⁴; the tangential terms move both by at most 6‖p‖r.
    """
    spend_on_fractions(40, radius**4, *camera.distortion)
    k1, k2, p1, p2 = camera.distortion
    below, above = [], []
    for f1, f2 in ((k1, k2), (3 * k1, 5 * k2)):
        terms = ((f1 * radius**2, f1 * reach**2), (f2 * radius**4, f2 * reach**4))
        below.append(1 + sum(map(min, terms)))
        above.append(1 + sum(map(max, terms)))
    tangential = 6 * root_above(p1 * p1 + p2 * p2) * reach
    return min(below) - tangential, min(above) + tangential


def _pixels_between(camera: Camera, inner: Fraction, outer: Fraction) -> Fraction:
    """Return a number ≤ σ_min ∫ λ dr from inner to outer [px]."""
    step = (outer - inner) / _RINGS
    radii = [inner + i * step for i in range(_RINGS)]
    total = sum((_ring(camera, r, r + step) for r in radii), Fraction(0))
    return least_stretch(camera)[0] * total


def _ring(camera: Camera, start: Fraction, end: Fraction) -> Fraction:
    """Return a number ≤ ∫ λ dr over a ring: the integral itself where one of both bounds is the lesser.

    Across is less than radially where k₁ + 2k₂r² > 0, and that changes sign once at most.
    """
    least, (k1, k2, p1, p2) = _eigenvalues(camera, start, end)[0], camera.distortion
    turns = sorted(k1 + 2 * k2 * r**2 for r in (start, end))
    if least <= 0:
        return Fraction(0)
    if turns[0] < 0 < turns[1]:
        return least * (end - start)
    a, b = (k1 / 3, k2 / 5) if turns[1] > 0 else (k1, k2)
    tangential = 3 * root_above(p1 * p1 + p2 * p2)
    low, high = (r + a * r**3 + b * r**5 - tangential * r**2 for r in (start, end))
    return high - low


def _folded(camera: Camera, radius: Fraction) -> bool:
    """True where the distortion is surely folded at this radius: the image then ends before the circle."""
    return _eigenvalues(camera, radius, radius)[1] <= 0


def _cross(a: Vector, b: Vector) -> Fraction:
    return a[0] * b[1] - a[1] * b[0]


def _outline_inside(camera: Camera, one: int, corners: list[Corner], inset: Fraction) -> Finding | None:
    """Return what is wrong with the distorted outline: along a side, u and v are polynomials of degree 5."""
    lines = {}
    for name, (l1, l2, l3) in edges(camera, inset).items():
        lines[name] = integers(
            l1 * camera.fx, l1 * camera.skew + l2 * camera.fy, l1 * camera.cx + l2 * camera.cy + l3
        )
    for i, (x1, y1) in enumerate(corners):
        x0, y0 = corners[i - 1]
        x, y, d = distort(([x0, x1 - x0], [0]), ([y0, y1 - y0], [0]), ([one], [0]), [0], camera.distortion)
        for name, weights in lines.items():
            found = nonnegative(combine_sums(*zip(weights, (x, y, d), strict=True))[0])
            if found.verdict != "holds":
                return Finding(
                    found.verdict, None, f"polygon side {i - 1 if i else len(corners) - 1} crosses the {name}"
                )
    return None


def _one_to_one(camera: Camera, one: int, corners: list[Corner]) -> Finding | None:
    """Return what is wrong unless the determinant is positive on all triangles (axis, vertex, vertex)."""
    stack = [(one, ((0, 0), corners[i - 1], corners[i])) for i in range(len(corners))]
    coefficients = integers(Fraction(1), *camera.distortion)
    for _ in range(_MOST_TRIANGLES):
        if not stack:
            return None
        scale, triangle = stack.pop()
        form = _determinant(coefficients, scale, triangle)
        if any(form.get(corner, 0) <= 0 for corner in (0, 8 * 16, 8)):
            return Finding("violated", None, "the distortion is not one-to-one on the polygon")
        if min(form.values()) < 0:
            stack += _bisected(scale, triangle)
    return Finding("undecided", None, "the distortion is hardly one-to-one on the polygon; not settled")


def _bisected(scale: int, triangle: Triangle) -> list[tuple[int, Triangle]]:
    """Halve the triangle through the middle of its longest side, all numbers doubled."""
    a, b = max(combinations(triangle, 2), key=lambda s: (s[0][0] - s[1][0]) ** 2 + (s[0][1] - s[1][1]) ** 2)
    opposite = next(c for c in triangle if c not in (a, b))
    middle = (a[0] + b[0], a[1] + b[1])
    doubled = {c: (2 * c[0], 2 * c[1]) for c in triangle}
    return [(2 * scale, (doubled[opposite], doubled[end], middle)) for end in (a, b)]


def _times(p: Form, q: Form) -> Form:
    spend(products(64 + 4 * len(p) * len(q), bits(p.values()), bits(q.values())))
    product: Form = {}
    for i, a in p.items():
        for j, b in q.items():
            product[i + j] = product.get(i + j, 0) + a * b
    return product


def _sum(*terms: tuple[int, Form]) -> Form:
    total: Form = {}
    for k, p in terms:
        for i, a in p.items():
            total[i] = total.get(i, 0) + k * a
    return total


def _determinant(coefficients: list[int], scale: int, triangle: Triangle) -> Form:
    """Return the determinant of the distortion's Jacobian, a form of degree 8 on the triangle.

    Its coefficients are the Bernstein coefficients times positive integers.
    """
    unit, k1, k2, p1, p2 = coefficients
    x, y = ({0: t[0], 16: t[1], 1: t[2]} for t in zip(*triangle, strict=True))
    one = {0: scale, 16: scale, 1: scale}
    square, cube = _times(one, one), _times(_times(one, one), one)
    xx, yy = _times(x, x), _times(y, y)
    s = _sum((1, xx), (1, yy))
    radial = _sum((unit, _times(square, square)), (k1, _times(s, square)), (k2, _times(s, s)))
    slope = _sum((2 * k1, square), (4 * k2, s))
    j_xx = _sum((1, radial), (1, _times(slope, xx)), (1, _times(cube, _sum((2 * p1, y), (6 * p2, x)))))
    j_yy = _sum((1, radial), (1, _times(slope, yy)), (1, _times(cube, _sum((6 * p1, y), (2 * p2, x)))))
    j_xy = _sum((1, _times(slope, _times(x, y))), (1, _times(cube, _sum((2 * p1, x), (2 * p2, y)))))
    return _sum((1, _times(j_xx, j_yy)), (-1, _times(j_xy, j_xy)))
