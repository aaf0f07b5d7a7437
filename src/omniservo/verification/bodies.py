"""Boxes and capsules: a core, and all that is at most ``radius`` away from it. The box's core is the box."""

from abc import ABC, abstractmethod
from collections.abc import Sequence
from dataclasses import dataclass
from fractions import Fraction
from math import sqrt

from omniservo.verification.fields import Vector
from omniservo.verification.motion import Motion
from omniservo.verification.work import spend, spend_on_fractions

_GOLDEN = (sqrt(5) - 1) / 2
_CUTS = 50
"""The golden ratio cuts a segment down to 4e-11 of it in so many steps."""


class Body(ABC):
    """A convex obstacle."""

    radius: Fraction
    """how far it reaches beyond its core [m]"""
    clearance: Fraction
    """what the camera centre keeps from it [m]"""
    motion: Motion | None
    """how it moves"""

    @abstractmethod
    def support(self, normal: Vector) -> Fraction:
        """Return the greatest n·x over the core."""

    @abstractmethod
    def nearer(self, x: Vector, distance: Fraction) -> bool:
        """Is x less than ``distance`` away from the core; negative: deeper in it than that?"""

    @abstractmethod
    def from_core(self, x: Sequence[float]) -> tuple[float, tuple[float, ...]]:
        """Return x's distance to the core (negative: depth) and direction, in floating point: a hint only."""

    def share_of(self, start: Sequence[float], end: Sequence[float]) -> float:
        """Return where on the segment it is nearest to the core, in floating point: a hint only.

        The distance to the core is convex along it.
        """
        spend(_CUTS * 150)

        def far(share: float) -> float:
            return self.from_core(between(start, end, share))[0]

        low, high, first, second = 0.0, 1.0, 1 - _GOLDEN, _GOLDEN
        at_first, at_second = far(first), far(second)
        for _ in range(_CUTS):
            if at_first <= at_second:
                high, second, at_second = second, first, at_first
                first = high - _GOLDEN * (high - low)
                at_first = far(first)
            else:
                low, first, at_first = first, second, at_second
                second = low + _GOLDEN * (high - low)
                at_second = far(second)
        return min((low, high, (low + high) / 2), key=far)


@dataclass(frozen=True)
class Box(Body):
    """The points center + Σ yₖ axesₖ with |yₖ| ≤ half_extentsₖ; the axes are exact and of length 1."""

    center: Vector
    axes: tuple[Vector, ...]
    half_extents: Vector
    clearance: Fraction
    motion: Motion | None = None
    radius: Fraction = Fraction(0)

    def support(self, normal: Vector) -> Fraction:
        """n·c + Σ hₖ|n·aₖ|."""
        reach = (h * abs(dot(normal, a)) for h, a in zip(self.half_extents, self.axes, strict=True))
        return dot(normal, self.center) + sum(reach)

    def nearer(self, x: Vector, distance: Fraction) -> bool:
        """Σ max(|yₖ| − hₖ, 0)² < distance²; inside, min(hₖ − |yₖ|) > −distance."""
        offset = tuple(a - b for a, b in zip(x, self.center, strict=True))
        beyond = [abs(dot(offset, a)) - h for a, h in zip(self.axes, self.half_extents, strict=True)]
        if max(beyond) <= 0:
            return max(beyond) < distance
        return distance > 0 and sum(b * b for b in beyond if b > 0) < distance * distance

    def from_core(self, x: Sequence[float]) -> tuple[float, tuple[float, ...]]:
        """Return x's signed distance to the box, and its direction."""
        axes = [[float(n) for n in a] for a in self.axes]
        offset = [a - float(b) for a, b in zip(x, self.center, strict=True)]
        along = [sum(p * q for p, q in zip(offset, a, strict=True)) for a in axes]
        beyond = [abs(y) - float(h) for y, h in zip(along, self.half_extents, strict=True)]
        size = max(beyond)
        if size > 0:
            weights = [max(b, 0.0) for b in beyond]
            size = sqrt(sum(b * b for b in weights))
        else:
            weights = [1.0 if b == size else 0.0 for b in beyond]
        signed = [-b if y < 0 else b for b, y in zip(weights, along, strict=True)]
        return size, tuple(sum(s * a[i] for s, a in zip(signed, axes, strict=True)) for i in range(3))


@dataclass(frozen=True)
class Capsule(Body):
    """The points at most ``radius`` away from the segment from start to end."""

    start: Vector
    end: Vector
    radius: Fraction
    clearance: Fraction
    motion: Motion | None = None

    def support(self, normal: Vector) -> Fraction:
        """max(n·start, n·end)."""
        return max(dot(normal, self.start), dot(normal, self.end))

    def nearer(self, x: Vector, distance: Fraction) -> bool:
        """‖x − nearest point of the segment‖² < distance²."""
        along = tuple(b - a for a, b in zip(self.start, self.end, strict=True))
        offset = tuple(a - b for a, b in zip(x, self.start, strict=True))
        length = dot(along, along)
        share = min(max(dot(offset, along) / length, Fraction(0)), Fraction(1)) if length else Fraction(0)
        apart = tuple(o - share * a for o, a in zip(offset, along, strict=True))
        return distance > 0 and dot(apart, apart) < distance * distance

    def from_core(self, x: Sequence[float]) -> tuple[float, tuple[float, ...]]:
        """Return x's distance to the segment, and its direction."""
        start = [float(a) for a in self.start]
        along = [float(b) - a for a, b in zip(start, self.end, strict=True)]
        offset = [a - b for a, b in zip(x, start, strict=True)]
        length = sum(a * a for a in along)
        share = sum(a * b for a, b in zip(offset, along, strict=True)) / length if length > 0 else 0.0
        share = min(max(share, 0.0), 1.0)
        apart = tuple(o - share * a for o, a in zip(offset, along, strict=True))
        return sqrt(sum(a * a for a in apart)), apart


def dot(a: Sequence[Fraction], b: Sequence[Fraction]) -> Fraction:
    """Return a·b."""
    return sum((x * y for x, y in zip(a, b, strict=True)), Fraction(0))


def axes_of(quaternion: Vector) -> tuple[Vector, ...]:
    """Return the columns of Λ(q)/‖q‖² (20): exact, and of length 1 whatever the quaternion's."""
    spend_on_fractions(40, *quaternion)
    x, y, z, w = quaternion
    squared = dot(quaternion, quaternion)
    rows = (
        (x * x - y * y - z * z + w * w, 2 * (x * y + z * w), 2 * (x * z - y * w)),
        (2 * (x * y - z * w), -x * x + y * y - z * z + w * w, 2 * (y * z + x * w)),
        (2 * (x * z + y * w), 2 * (y * z - x * w), -x * x - y * y + z * z + w * w),
    )
    return tuple(tuple(a / squared for a in row) for row in rows)


def between(start: Sequence[float], end: Sequence[float], share: float) -> list[float]:
    """Return start + share·(end − start)."""
    return [a + share * (b - a) for a, b in zip(start, end, strict=True)]
