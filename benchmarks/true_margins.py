"""True margins of a plan file, from poses, pixels and distances alone: no polynomial, no code of ours.

A constraint's least margin is looked for at many w in floating point, then refined with 30 digits. What is
returned is the margin at a w, so the truth is at most that.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from itertools import pairwise
from typing import Any, NamedTuple

import mpmath
from benchmarks.true_distances import beyond, obstacle_lines
from benchmarks.true_pixels import image_lines
from benchmarks.true_views import Line, View, length, minus, view

SAMPLES, SPARSE = 300, 10
"""w is looked at in so many steps; first at every tenth, to see which points and parts may be the lowest."""
REFINED = 6
"""So many of the lowest places are refined."""
_DIGITS, _STEPS = 30, 40


class Truth(NamedTuple):
    """The least margin of one constraint."""

    name: str
    unit: str
    margin: mpmath.mpf
    w: mpmath.mpf
    needed: mpmath.mpf
    """what the margin is relative to: the distance asked for and the margin, in the constraint's unit"""
    away: tuple[float, ...]
    """of an obstacle: where it would have to move for more room; a unit vector where the truth is smooth"""


class Place(NamedTuple):
    """A sample where a line is lower than beside it."""

    value: float
    k: int
    slope: float
    """how much the value changes to the next samples"""
    line: Line
    h: list[float]


def true_margins(document: dict[str, Any]) -> dict[str, Truth]:
    """Return the least margin of every constraint of a plan file."""
    problem, path = document["problem"], document["path"]
    seen: dict[str, list[tuple[Line, list[float]]]] = {}
    for line in lines(problem):
        seen.setdefault(line.name, []).extend(
            (line, h) for h in (problem["points"] if line.about_point else [[]])
        )
    return {name: _truth(path, _places(found, path)) for name, found in seen.items()}


def _places(seen: list[tuple[Line, list[float]]], path: dict[str, Any]) -> list[Place]:
    """Return where points and parts of one constraint are low, the lowest first."""
    lows = []
    for line, h in seen:
        values = [v for v in _values(line, path, h, SPARSE) if v < math.inf]
        step = max((abs(b - a) for a, b in pairwise(values)), default=0.0)
        lows.append((min(values, default=math.inf), step))
    best = min(low for low, _ in lows)
    places = []
    for (line, h), (low, step) in zip(seen, lows, strict=True):
        if low - step <= best:
            places += _low_places(line, path, h)
    return sorted(places, key=lambda place: place.value)


def _values(line: Line, path: dict[str, Any], h: list[float], every: int) -> list[float]:
    steps = range(0, SAMPLES + 1, every)
    return [float(line.margin(view(path, h, k / SAMPLES, math, line.motion))) for k in steps]


def _low_places(line: Line, path: dict[str, Any], h: list[float]) -> Iterator[Place]:
    values = _values(line, path, h, 1)
    for k, value in enumerate(values):
        beside = values[max(0, k - 1) : k + 2]
        if value == min(beside) and value < math.inf:
            yield Place(value, k, max(beside) - value, line, h)


def _truth(path: dict[str, Any], places: list[Place]) -> Truth:
    """Refine what may be the lowest place."""
    limit = places[0].value + places[0].slope
    found = [(*refined(p, path), p) for p in places[:REFINED] if p.value <= limit]
    w, margin, place = min(found, key=lambda f: f[1])
    line = place.line
    away = _away(place, path, w) if "obstacle" in line.name else ()
    return Truth(line.name, line.unit, margin, w, abs(margin) + line.asked, away)


def refined(place: Place, path: dict[str, Any]) -> tuple[mpmath.mpf, mpmath.mpf]:
    """Return where near the sample the margin is least, and the margin there (golden section)."""
    k, line = place.k, place.line

    def at(w: Any) -> Any:
        return line.margin(view(path, place.h, w, mpmath, line.motion))

    with mpmath.workdps(_DIGITS):
        low, high = mpmath.mpf(max(0, k - 1)) / SAMPLES, mpmath.mpf(min(SAMPLES, k + 1)) / SAMPLES
        share = (mpmath.sqrt(5) - 1) / 2
        inner = [high - share * (high - low), low + share * (high - low)]
        values = [at(w) for w in inner]
        for _ in range(_STEPS):
            if values[0] <= values[1]:
                high = inner[1]
                inner = [high - share * (high - low), inner[0]]
                values = [at(inner[0]), values[0]]
            else:
                low = inner[0]
                inner = [inner[1], low + share * (high - low)]
                values = [values[1], at(inner[1])]
        ends = [mpmath.mpf(0), mpmath.mpf(1), mpmath.mpf(k) / SAMPLES, *inner]
        return min(((w, at(w)) for w in ends), key=lambda pair: pair[1])


def _away(place: Place, path: dict[str, Any], w: mpmath.mpf) -> tuple[float, ...]:
    """Return the margin's gradient by the obstacle's place, by differences."""
    with mpmath.workdps(_DIGITS):
        seen, step = view(path, place.h, w, mpmath, place.line.motion), mpmath.mpf(10) ** -12
        found = []
        for axis in range(3):
            shift = [step * (i == axis) for i in range(3)]
            sides = []
            for by in (shift, [-x for x in shift]):
                moved = View(mpmath, w, seen.phi, minus(seen.t, by), minus(seen.h, by) if seen.h else [])
                sides.append(place.line.margin(moved))
            found.append(float((sides[0] - sides[1]) / (2 * step)))
        return tuple(found)


def lines(problem: dict[str, Any]) -> Iterator[Line]:
    """Yield every constraint of a problem, some of them in parts."""
    for i, obstacle in enumerate(problem.get("obstacles", ())):
        yield from obstacle_lines(problem, i, obstacle)
    inside = problem.get("workspace") or {}
    for side, sign in (("min", 1), ("max", -1)):
        for k, bound in enumerate(inside.get(side) or ()):
            name = f"workspace {'xyz'[k]} {side}"
            yield Line(name, "m", False, lambda v, k=k, s=sign, b=bound: s * (v.t[k] - b), abs(bound))
    for i, plane in enumerate(inside.get("half_spaces") or ()):
        name = f"workspace half-space {i}"
        yield Line(name, "m", False, lambda v, p=plane: beyond(v, p), abs(plane["offset"]))
    yield Line("rotation", "1", False, lambda v: sum(p * p for p in v.phi) - v.num.sqrt(1) / 100, 0.01)
    least = problem.get("least_distance", 1e-3)
    yield Line("least_distance", "m", True, lambda v: length(v, minus(v.h, v.t)) - least, least)
    yield from image_lines(problem["camera"], problem.get("visibility_margin", 0.0))
