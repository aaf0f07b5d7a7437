"""What an obstacle sees from where it has moved to: everything about it holds for t − m and h − m."""

from dataclasses import dataclass
from fractions import Fraction
from math import lcm

from omniservo.verification.camera_path import CameraPath
from omniservo.verification.fields import Vector
from omniservo.verification.polynomials import Polynomial, combine, value
from omniservo.verification.work import spend, spend_on_fractions

Motion = tuple[Vector, ...]
"""m(w) [m]: three rows of coefficients, highest power of w first"""
_STILL: Motion = ((Fraction(0),),) * 3
_SEEN = 600
"""What looking from an obstacle costs in small steps, in the unit of `work`."""


@dataclass(frozen=True)
class Relative:
    """The camera centre and a target point relative to a moving obstacle, as integer polynomials."""

    scale: int
    camera: tuple[Polynomial, ...]
    """(t − m)·scale"""
    target: tuple[Polynomial, ...]
    """(h − m)·scale; empty where no point is meant"""

    def camera_at(self, w: Fraction) -> Vector:
        """Return t(w) − m(w) [m]."""
        return tuple(value(p, w) / self.scale for p in self.camera)

    def target_at(self, w: Fraction) -> Vector:
        """Return h − m(w) [m]."""
        return tuple(value(p, w) / self.scale for p in self.target)

    def camera_from(self, center: Vector) -> list[Polynomial]:
        """Return (t − m − center)·scale."""
        return [_less(p, x, self.scale) for p, x in zip(self.camera, center, strict=True)]

    def target_from(self, center: Vector) -> list[Polynomial]:
        """Return (h − m − center)·scale."""
        return [_less(p, x, self.scale) for p, x in zip(self.target, center, strict=True)]


def relative(
    path: CameraPath, motion: Motion | None, *, unit: int = 1, target: Vector | None = None
) -> Relative:
    """Return path and target point as the obstacle sees them; the scale is a multiple of ``unit``."""
    rows = motion or _STILL
    scale = lcm(path.scale, unit, *(unit_of(row) for row in rows))
    moved = [[int(x * scale) for x in reversed(row)] for row in rows]
    spend(_SEEN)
    spend_on_fractions(3 * (len(rows[0]) + len(path.translation[0])), Fraction(scale))
    factor = scale // path.scale
    camera = tuple(combine((factor, p), (-1, m)) for p, m in zip(path.translation, moved, strict=True))
    ends = [[int(x * scale)] for x in target or ()]
    return Relative(scale, camera, tuple(combine((1, h), (-1, m)) for h, m in zip(ends, moved, strict=False)))


def unit_of(numbers: Vector) -> int:
    """Return what the numbers must be multiplied by to become integers."""
    return lcm(*(x.denominator for x in numbers))


def _less(p: Polynomial, x: Fraction, scale: int) -> Polynomial:
    return [p[0] - x.numerator * (scale // x.denominator), *p[1:]]
