"""The nearest points of a hull of corners and a segment, in floating point: hints, which are checked exactly.

Gilbert, Johnson and Keerthi's algorithm; the nearest point of a simplex by trying all of its faces.
"""

from collections.abc import Sequence
from itertools import combinations
from math import inf
from typing import NamedTuple

from omniservo.verification.work import spend

Point = tuple[float, ...]
_MOST_STEPS, _CLOSE = 64, 1e-13


class Corner(NamedTuple):
    """A corner of the hull that carries the nearest point, with the end of the segment that faces it."""

    vertex: int
    side: int
    """0: the segment's start, 1: its end"""
    weight: float


def nearest(
    corners: Sequence[Point], start: Sequence[float], end: Sequence[float]
) -> tuple[Point, list[Corner]]:
    """Return (nearest point of the segment) − (nearest point of the hull), and the corners that carry it.

    Four corners carry it where the two meet.
    """
    ends = start, end
    simplex = {(0, 0): tuple(s - c for s, c in zip(start, corners[0], strict=True))}
    reached, steps = inf, 0
    while True:
        apart, weights = _lowest(list(simplex.values()))
        keys = list(simplex)
        simplex = {keys[k]: simplex[keys[k]] for k in weights}
        size = dot(apart, apart)
        x, y, z = apart
        spend(1000 + 8 * len(corners))
        heights = [x * a + y * b + z * c for a, b, c in corners]
        index, side = heights.index(max(heights)), int(dot(apart, end) < dot(apart, start))
        new = tuple(s - c for s, c in zip(ends[side], corners[index], strict=True))
        met = len(simplex) == 4 or size <= _CLOSE**2 * dot(new, new)
        steps += 1
        if met or not size < reached or not size - dot(apart, new) > _CLOSE * size or steps == _MOST_STEPS:
            break
        reached = size
        simplex[index, side] = new
    return apart, [Corner(*key, w) for key, w in zip(simplex, weights.values(), strict=True)]


def dot(a: Sequence[float], b: Sequence[float]) -> float:
    """Return a·b."""
    return sum(x * y for x, y in zip(a, b, strict=True))


def _lowest(points: list[Point]) -> tuple[Point, dict[int, float]]:
    """Return the point nearest to the origin of the hull of up to four points, and its weights."""
    found: tuple[float, Point, dict[int, float]] | None = None
    for count in range(1, len(points) + 1):
        for chosen in combinations(range(len(points)), count):
            weights = _weights([points[k] for k in chosen])
            if weights is None or min(weights) <= 0:
                continue
            at = tuple(sum(w * points[k][i] for w, k in zip(weights, chosen, strict=True)) for i in range(3))
            size = dot(at, at)
            if found is None or size < found[0]:
                found = size, at, dict(zip(chosen, weights, strict=True))
    return (points[0], {0: 1.0}) if found is None else found[1:]


def _weights(points: list[Point]) -> list[float] | None:
    """Return the weights, of sum 1, of the point nearest to the origin on the flat through the points."""
    first = points[0]
    sides = [tuple(a - b for a, b in zip(p, first, strict=True)) for p in points[1:]]
    solved = _solve([[dot(a, b) for b in sides] for a in sides], [-dot(a, first) for a in sides])
    return None if solved is None else [1.0 - sum(solved), *solved]


def _solve(matrix: list[list[float]], right: list[float]) -> list[float] | None:
    """Solve a small symmetric system by elimination; None where it is singular."""
    rows = [[*row, r] for row, r in zip(matrix, right, strict=True)]
    for k in range(len(rows)):
        pivot = rows[k][k]
        if not pivot > 0.0:
            return None
        for row in rows[k + 1 :]:
            factor = row[k] / pivot
            row[k:] = [a - factor * b for a, b in zip(row[k:], rows[k][k:], strict=True)]
    solved: list[float] = []
    for row in reversed(rows):
        known = row[len(rows) - len(solved) : -1]
        rest = sum(a * b for a, b in zip(known, solved, strict=True))
        solved.insert(0, (row[-1] - rest) / row[len(rows) - len(solved) - 1])
    return solved
