"""The camera's path, and what a target point looks like along it, as integer polynomials."""

from collections.abc import Iterator
from dataclasses import dataclass
from fractions import Fraction
from math import copysign, lcm, sqrt

from omniservo.verification.fields import Vector
from omniservo.verification.polynomials import Polynomial, combine, integers, squares, times, value
from omniservo.verification.work import spend, spend_on_fractions

_POINT = 800
"""What a target point costs in small steps, in the unit of `work`."""


@dataclass(frozen=True)
class CameraPath:
    """The pose {Λ(φ)/‖φ‖², t} at w in [0, 1], (23).

    Lengths are multiplied by ``scale`` and the quaternion by ``turn_scale``: all coefficients are integers.
    """

    rotation: tuple[Polynomial, ...]
    """φ·turn_scale: x, y, z, w"""
    translation: tuple[Polynomial, ...]
    """t·scale"""
    scale: int
    turn_scale: int

    def position(self, w: Fraction) -> Vector:
        """Return t(w) [m]."""
        return tuple(value(p, w) / self.scale for p in self.translation)

    def quaternion(self, w: Fraction) -> Vector:
        """Return φ(w), unnormalised."""
        return tuple(value(p, w) / self.turn_scale for p in self.rotation)

    def offsets(self, point: Vector) -> list[Polynomial]:
        """Return (t − point)·scale of a target point, one polynomial a coordinate."""
        return [[p[0] - int(x * self.scale), *p[1:]] for p, x in zip(self.translation, point, strict=True)]


@dataclass(frozen=True)
class CameraPoint:
    """A target point h seen from the path: c = Λ(φ)ᵀ(h − t) and q = ‖c‖² = ‖φ‖⁴‖h − t‖².

    (X, Y, Z) = c and √q carry one common positive factor.
    """

    path: CameraPath
    index: int
    point: Vector
    x: Polynomial
    y: Polynomial
    z: Polynomial
    q: Polynomial
    distance_squared: Polynomial
    """‖h − t‖²·scale²"""

    def coordinates(self, w: Fraction) -> tuple[float, float, float, float]:
        """Return (X, Y, Z, ρ)/ρ in floating point, for messages only; zeros where ρ = 0."""
        rho_squared = value(self.q, w)
        if rho_squared == 0:
            return 0.0, 0.0, 0.0, 0.0
        x, y, z = (value(p, w) for p in (self.x, self.y, self.z))
        bx, by, bz = (copysign(sqrt(c * c / rho_squared), c) for c in (x, y, z))
        return bx, by, bz, 1.0


def camera_path(
    rotation: tuple[Vector, ...], translation: tuple[Vector, ...], points: tuple[Vector, ...]
) -> CameraPath:
    """Build the path from its rows of coefficients, highest power first, in the file's numbers."""
    scale = lcm(*{x.denominator for vector in (*translation, *points) for x in vector})
    turns = integers(*(x for row in rotation for x in row))
    columns = len(rotation[0])
    turn_scale = lcm(*{x.denominator for row in rotation for x in row})
    return CameraPath(
        rotation=tuple(turns[i * columns : (i + 1) * columns][::-1] for i in range(4)),
        translation=tuple([int(x * scale) for x in reversed(row)] for row in translation),
        scale=scale,
        turn_scale=turn_scale,
    )


def camera_points(path: CameraPath, points: tuple[Vector, ...]) -> Iterator[CameraPoint]:
    """Yield every target point as the camera sees it."""
    matrix = _rotation_matrix(path.rotation)
    norm_fourth = squares(squares(*path.rotation))
    for index, point in enumerate(points):
        spend(_POINT)
        spend_on_fractions(6, Fraction(path.scale))
        away = [[-a for a in p] for p in path.offsets(point)]
        x, y, z = (combine(*((1, times(matrix[i][k], away[i])) for i in range(3))) for k in range(3))
        distance_squared = squares(*away)
        yield CameraPoint(path, index, point, x, y, z, times(norm_fourth, distance_squared), distance_squared)


def _rotation_matrix(quaternion: tuple[Polynomial, ...]) -> list[list[Polynomial]]:
    """Return Λ(φ) of (20) = ‖φ‖²R, for φ = (x, y, z, w)."""
    xx, yy, zz, ww = (times(p, p) for p in quaternion)
    x, y, z, w = quaternion
    xy, xz, yz = times(x, y), times(x, z), times(y, z)
    xw, yw, zw = times(x, w), times(y, w), times(z, w)
    return [
        [
            combine((1, xx), (-1, yy), (-1, zz), (1, ww)),
            combine((2, xy), (-2, zw)),
            combine((2, xz), (2, yw)),
        ],
        [
            combine((2, xy), (2, zw)),
            combine((-1, xx), (1, yy), (-1, zz), (1, ww)),
            combine((2, yz), (-2, xw)),
        ],
        [
            combine((2, xz), (-2, yw)),
            combine((2, yz), (2, xw)),
            combine((-1, xx), (-1, yy), (1, zz), (1, ww)),
        ],
    ]
