"""Cylinders and ellipsoids: their supports are roots, taken to the side that is safe for a claim."""

from collections.abc import Sequence
from dataclasses import dataclass
from fractions import Fraction
from math import copysign, sqrt

from omniservo.verification.bodies import Body, dot
from omniservo.verification.enclosures import root_above, root_below
from omniservo.verification.fields import Vector
from omniservo.verification.motion import Motion

_NEWTON_STEPS = 100


@dataclass(frozen=True)
class Cylinder(Body):
    """The points between two discs of radius ``across`` about start and end, across end − start."""

    start: Vector
    end: Vector
    across: Fraction
    clearance: Fraction
    motion: Motion | None = None
    radius: Fraction = Fraction(0)

    def support(self, normal: Vector) -> Fraction:
        """max(n·start, n·end) + across √(‖n‖² − (n·d)²/‖d‖²), d = end − start; not less than that."""
        along = self._along
        flat = dot(normal, normal) - dot(normal, along) ** 2 / dot(along, along)
        return max(dot(normal, self.start), dot(normal, self.end)) + self.across * root_above(flat)

    def nearer(self, x: Vector, distance: Fraction) -> bool:
        """Beyond the ends by b, off the axis by ρ: b² + max(ρ − across, 0)² < distance²; or both depths."""
        along, offset = self._along, _minus(x, self.start)
        length, share = dot(along, along), dot(offset, along) / dot(along, along)
        off_axis = dot(offset, offset) - share**2 * length
        if distance <= 0:
            least = self.across + distance
            return (
                0 <= share <= 1
                and min(share, 1 - share) ** 2 * length > distance**2
                and least > 0
                and off_axis < least**2
            )
        beyond = max(-share, share - 1, Fraction(0)) ** 2 * length
        if beyond >= distance**2:
            return False
        return off_axis <= self.across**2 or off_axis < (self.across + root_below(distance**2 - beyond)) ** 2

    def from_core(self, x: Sequence[float]) -> tuple[float, tuple[float, ...]]:
        """Return x's signed distance to the cylinder, and its direction."""
        axis = [float(a) for a in self._along]
        length = sqrt(sum(a * a for a in axis))
        axis = [a / length for a in axis]
        middle = [(float(a) + float(b)) / 2 for a, b in zip(self.start, self.end, strict=True)]
        offset = [a - b for a, b in zip(x, middle, strict=True)]
        height = sum(a * b for a, b in zip(offset, axis, strict=True))
        across = [o - height * a for o, a in zip(offset, axis, strict=True)]
        rho = sqrt(sum(a * a for a in across))
        across = [a / rho for a in across] if rho > 0 else [0.0, 0.0, 0.0]
        parts = [abs(height) - length / 2, rho - float(self.across)]
        size = max(parts)
        if size > 0:
            weights = [max(p, 0.0) for p in parts]
            size = sqrt(weights[0] ** 2 + weights[1] ** 2)
        else:
            weights = [1.0 if p == size else 0.0 for p in parts]
        up = copysign(weights[0], height)
        return size, tuple(up * a + weights[1] * b for a, b in zip(axis, across, strict=True))

    @property
    def _along(self) -> Vector:
        return _minus(self.end, self.start)


@dataclass(frozen=True)
class Ellipsoid(Body):
    """The points center + Σ yₖ axesₖ with Σ (yₖ/radiiₖ)² ≤ 1; the axes are exact and of length 1."""

    center: Vector
    axes: tuple[Vector, ...]
    radii: Vector
    clearance: Fraction
    motion: Motion | None = None
    radius: Fraction = Fraction(0)

    def support(self, normal: Vector) -> Fraction:
        """n·c + √(Σ (rₖ n·aₖ)²); not less than that."""
        squares = ((r * dot(normal, a)) ** 2 for r, a in zip(self.radii, self.axes, strict=True))
        return dot(normal, self.center) + root_above(sum(squares, Fraction(0)))

    def nearer(self, x: Vector, distance: Fraction) -> bool:
        """A point of the ellipsoid shows it; inside, with ρ² = Σ (yₖ/rₖ)², (1 − ρ) min r > −distance."""
        along = self._own(x)
        squared = self._level(along)
        if distance <= 0:
            least = 1 + distance / min(self.radii)
            return least > 0 and squared < least**2
        if squared <= 1:
            return True
        near = tuple(Fraction(a) for a in self._nearest([float(a) for a in along])[1])
        level = self._level(near)
        if level > 1:
            near = tuple(a / root_above(level) for a in near)
        apart = _minus(along, near)
        return dot(apart, apart) < distance**2

    def from_core(self, x: Sequence[float]) -> tuple[float, tuple[float, ...]]:
        """Return x's distance to the ellipsoid, negative: a depth that it has at least, and its direction."""
        axes = [[float(n) for n in a] for a in self.axes]
        offset = [a - float(b) for a, b in zip(x, self.center, strict=True)]
        along = [sum(p * q for p, q in zip(offset, a, strict=True)) for a in axes]
        size, _, normal = self._nearest(along)
        return size, tuple(sum(n * a[i] for n, a in zip(normal, axes, strict=True)) for i in range(3))

    def _own(self, x: Vector) -> Vector:
        offset = _minus(x, self.center)
        return tuple(dot(offset, a) for a in self.axes)

    def _level(self, along: Vector) -> Fraction:
        return sum(((a / r) ** 2 for a, r in zip(along, self.radii, strict=True)), Fraction(0))

    def _nearest(self, along: Sequence[float]) -> tuple[float, list[float], list[float]]:
        """Return distance (inside: minus a depth), nearest point and direction, in the ellipsoid's own axes.

        The nearest point is r² y/(s + r²), s ≥ 0 the root of Σ (r y/(s + r²))² = 1.
        """
        radii = [float(r) for r in self.radii]
        rho = sqrt(sum((a / r) ** 2 for a, r in zip(along, radii, strict=True)))
        s = max(0.0, *(r * abs(a) - r * r for a, r in zip(along, radii, strict=True))) if rho > 1 else 0.0
        for _ in range(_NEWTON_STEPS if rho > 1 else 0):
            parts = [((r * a / (s + r * r)) ** 2, s + r * r) for a, r in zip(along, radii, strict=True)]
            step = (sum(p for p, _ in parts) - 1) / sum(2 * p / below for p, below in parts)
            if not step > 1e-16 * s:
                break
            s += step
        normal = [a / (s + r * r) for a, r in zip(along, radii, strict=True)]
        near = [r * r * n for r, n in zip(radii, normal, strict=True)]
        if rho <= 1:
            return -(1 - rho) * min(radii), list(along), normal if any(normal) else [1.0, 0.0, 0.0]
        return s * sqrt(sum(n * n for n in normal)), near, normal


def _minus(a: Vector, b: Vector) -> Vector:
    return tuple(x - y for x, y in zip(a, b, strict=True))
