"""A target point seen from a path at one w, and the arithmetic of it: for floats and for 30 digits alike."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any, NamedTuple

Numbers = list[Any]
"""of floats, or of mpmath's numbers"""
Rows = Sequence[Sequence[float]]
"""coefficients, highest power of w first"""


class View(NamedTuple):
    """A target point from the camera at w; the path alone where h is empty."""

    num: Any
    """the module whose functions belong to the numbers: math or mpmath"""
    w: Any
    phi: Numbers
    t: Numbers
    h: Numbers


class Line(NamedTuple):
    """A constraint, or a part of it: lines of one name together have the least of their margins."""

    name: str
    unit: str
    about_point: bool
    margin: Callable[[View], Any]
    asked: float
    """what the problem asks for, in the unit"""
    motion: Rows = ()
    """t and h are seen from where this has moved to"""


def view(path: dict[str, Any], h: Sequence[float], w: Any, num: Any, motion: Rows = ()) -> View:
    """Return the pose at w by Horner; with a motion m, t − m and h − m."""
    phi, t = ([horner(row, w) for row in path[name]] for name in ("rotation", "translation"))
    point = [0 * w + x for x in h]
    if motion:
        moved = [horner(row, w) for row in motion]
        t, point = minus(t, moved), minus(point, moved) if point else []
    return View(num, w, phi, t, point)


def horner(row: Sequence[float], w: Any) -> Any:
    """Return the polynomial's value at w."""
    total = 0 * w
    for coefficient in row:
        total = total * w + coefficient
    return total


def in_camera(v: View) -> Numbers:
    """Return Rᵀ(h − t)."""
    x, y, z, s = v.phi
    size = x * x + y * y + z * z + s * s
    a, b, c = minus(v.h, v.t)
    return [
        ((x * x - y * y - z * z + s * s) * a + 2 * (x * y + z * s) * b + 2 * (x * z - y * s) * c) / size,
        (2 * (x * y - z * s) * a + (y * y - x * x - z * z + s * s) * b + 2 * (y * z + x * s) * c) / size,
        (2 * (x * z + y * s) * a + 2 * (y * z - x * s) * b + (z * z - x * x - y * y + s * s) * c) / size,
    ]


def exact(v: View, numbers: Sequence[float]) -> Numbers:
    """Return numbers of a file as numbers of the view's kind."""
    return [0 * v.w + x for x in numbers]


def minus(a: Sequence[Any], b: Sequence[Any]) -> Numbers:
    """Return a − b."""
    return [x - y for x, y in zip(a, b, strict=True)]


def dot(a: Sequence[Any], b: Sequence[Any]) -> Any:
    """Return a·b."""
    return sum(x * y for x, y in zip(a, b, strict=True))


def cross(a: Sequence[Any], b: Sequence[Any]) -> Numbers:
    """Return a × b."""
    return [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]]


def length(v: View, vector: Sequence[Any]) -> Any:
    """Return ‖vector‖."""
    return v.num.sqrt(sum(x * x for x in vector))
