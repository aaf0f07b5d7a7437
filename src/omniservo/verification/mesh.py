"""Convex meshes: the hull of vertices, whose support is a maximum over them."""

from collections.abc import Sequence
from dataclasses import dataclass
from fractions import Fraction
from functools import cached_property
from math import sqrt
from operator import mul
from typing import TypeVar

from omniservo.verification.bodies import Body, dot
from omniservo.verification.fields import Vector
from omniservo.verification.motion import Motion
from omniservo.verification.nearest_point import Corner, Point, nearest
from omniservo.verification.polynomials import integers
from omniservo.verification.work import bits, products, spend

Integers = tuple[int, ...]
Number = TypeVar("Number", int, Fraction)


@dataclass(frozen=True)
class Mesh(Body):
    """The convex hull of vertices/scale."""

    vertices: tuple[Integers, ...]
    scale: int
    clearance: Fraction
    motion: Motion | None = None
    radius: Fraction = Fraction(0)

    def support(self, normal: Vector) -> Fraction:
        """Max over the vertices of n·v."""
        one, x, y, z = integers(Fraction(1), *normal)
        spend(products(4 * len(self.vertices), bits((x, y, z)), self._longest))
        return Fraction(max(x * a + y * b + z * c for a, b, c in self.vertices), one * self.scale)

    def nearer(self, x: Vector, distance: Fraction) -> bool:
        """True where a point of the hull shows it; inside, where a tetrahedron of vertices does."""
        corners = self._nearest(x, x)[1]
        chosen = [self._vertex(c.vertex) for c in corners]
        if distance <= 0:
            depth = _depth_squared(x, chosen) if len(chosen) == 4 else None
            return depth is not None and depth > distance**2
        weights = [Fraction(c.weight) for c in corners]
        near = tuple(dot(weights, column) / sum(weights) for column in zip(*chosen, strict=True))
        apart = _minus(x, near)
        return dot(apart, apart) < distance**2

    def from_core(self, x: Sequence[float]) -> tuple[float, tuple[float, ...]]:
        """Return x's distance to the hull, and its direction; inside, a tetrahedron's depth."""
        apart, corners = self._nearest(x, x)
        depth = None
        if len(corners) == 4:
            depth = _depth_squared(tuple(map(Fraction, x)), [self._vertex(c.vertex) for c in corners])
        return (-sqrt(depth) if depth else sqrt(sum(a * a for a in apart))), apart

    def share_of(self, start: Sequence[float], end: Sequence[float]) -> float:
        """Return where on the segment it is nearest to the hull, in floating point."""
        return sum(c.weight * c.side for c in self._nearest(start, end)[1])

    def _nearest(
        self, start: Sequence[float] | Vector, end: Sequence[float] | Vector
    ) -> tuple[tuple[float, ...], list[Corner]]:
        return nearest(self._corners, [float(a) for a in start], [float(a) for a in end])

    def _vertex(self, index: int) -> Vector:
        return tuple(Fraction(a, self.scale) for a in self.vertices[index])

    @cached_property
    def _longest(self) -> int:
        return bits(a for vertex in self.vertices for a in vertex)

    @cached_property
    def _corners(self) -> list[Point]:
        return [tuple(a / self.scale for a in vertex) for vertex in self.vertices]


def is_flat(vertices: Sequence[Integers]) -> bool:
    """True where all vertices lie in one plane."""
    away = [_minus(v, vertices[0]) for v in vertices]
    along = next((v for v in away if any(v)), None)
    normals = (_cross(along, v) for v in away) if along is not None else ()
    normal = next((n for n in normals if any(n)), None)
    return normal is None or not any(sum(map(mul, normal, v)) for v in away)


def _depth_squared(x: Vector, corners: Sequence[Vector]) -> Fraction | None:
    """Return x's least squared distance to the faces of a tetrahedron; None where it is not inside."""
    found = []
    for i in range(4):
        a, b, c = (corners[k] for k in range(4) if k != i)
        n = _cross(_minus(b, a), _minus(c, a))
        inward, height = dot(n, _minus(corners[i], a)), dot(n, _minus(x, a))
        if inward * height <= 0:
            return None
        found.append(height**2 / dot(n, n))
    return min(found)


def _minus(a: tuple[Number, ...], b: tuple[Number, ...]) -> tuple[Number, ...]:
    return tuple(x - y for x, y in zip(a, b, strict=True))


def _cross(a: tuple[Number, ...], b: tuple[Number, ...]) -> tuple[Number, ...]:
    return (a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0])
