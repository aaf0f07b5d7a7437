"""True margins of a plan file, from poses, pixels and distances alone: no polynomial, no code of ours.

A constraint's least margin is looked for at many w in floating point, then refined with 30 digits. What is
returned is the margin at a w, so the truth is at most that.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from typing import Any, NamedTuple

import mpmath

SAMPLES = 300
_DIGITS, _STEPS = 30, 40
Numbers = list[Any]
"""of floats, or of mpmath's numbers"""


class View(NamedTuple):
    """A target point from the camera at w; the path alone where h is empty."""

    num: Any
    """the module whose functions belong to the numbers: math or mpmath"""
    w: Any
    phi: Numbers
    t: Numbers
    h: Numbers


class Truth(NamedTuple):
    """The least margin of one constraint."""

    name: str
    unit: str
    margin: mpmath.mpf
    w: mpmath.mpf
    needed: mpmath.mpf
    """what the margin is relative to: the distance asked for and the margin, in the constraint's unit"""


class Line(NamedTuple):
    """A constraint: its margin in a view, and what the problem asks for."""

    name: str
    unit: str
    about_point: bool
    margin: Callable[[View], Any]
    asked: float


def true_margins(document: dict[str, Any]) -> dict[str, Truth]:
    """Return the least margin of every constraint of a plan file."""
    problem, path = document["problem"], document["path"]
    points = problem["points"]
    found = {}
    for line in lines(problem):
        targets = points if line.about_point else [[]]
        coarse = [
            (line.margin(view(path, h, k / SAMPLES, math)), k, j)
            for k in range(SAMPLES + 1)
            for j, h in enumerate(targets)
        ]
        _, k, j = min(coarse)
        w, margin = refined(line, path, targets[j], k)
        found[line.name] = Truth(line.name, line.unit, margin, w, abs(margin) + line.asked)
    return found


def refined(line: Line, path: dict[str, Any], h: list[float], k: int) -> tuple[mpmath.mpf, mpmath.mpf]:
    """Return where near sample k the margin is least, and the margin there (golden section)."""
    with mpmath.workdps(_DIGITS):
        low, high = mpmath.mpf(max(0, k - 1)) / SAMPLES, mpmath.mpf(min(SAMPLES, k + 1)) / SAMPLES
        share = (mpmath.sqrt(5) - 1) / 2
        inner = [high - share * (high - low), low + share * (high - low)]
        values = [line.margin(view(path, h, w, mpmath)) for w in inner]
        for _ in range(_STEPS):
            if values[0] <= values[1]:
                high = inner[1]
                inner = [high - share * (high - low), inner[0]]
                values = [line.margin(view(path, h, inner[0], mpmath)), values[0]]
            else:
                low = inner[0]
                inner = [inner[1], low + share * (high - low)]
                values = [values[1], line.margin(view(path, h, inner[1], mpmath))]
        ends = [mpmath.mpf(0), mpmath.mpf(1), mpmath.mpf(k) / SAMPLES, *inner]
        return min(((w, line.margin(view(path, h, w, mpmath))) for w in ends), key=lambda pair: pair[1])


def view(path: dict[str, Any], h: list[float], w: Any, num: Any) -> View:
    """Return the pose at w by Horner."""
    rows = []
    for row in (*path["rotation"], *path["translation"]):
        total = 0 * w
        for coefficient in row:
            total = total * w + coefficient
        rows.append(total)
    return View(num, w, rows[:4], rows[4:], [0 * w + x for x in h])


def in_camera(v: View) -> Numbers:
    """Return Rᵀ(h − t)."""
    x, y, z, s = v.phi
    size = x * x + y * y + z * z + s * s
    a, b, c = (p - q for p, q in zip(v.h, v.t, strict=True))
    return [
        ((x * x - y * y - z * z + s * s) * a + 2 * (x * y + z * s) * b + 2 * (x * z - y * s) * c) / size,
        (2 * (x * y - z * s) * a + (y * y - x * x - z * z + s * s) * b + 2 * (y * z + x * s) * c) / size,
        (2 * (x * z + y * s) * a + 2 * (y * z - x * s) * b + (z * z - x * x - y * y + s * s) * c) / size,
    ]


def length(v: View, vector: Numbers) -> Any:
    """Return ‖vector‖."""
    return v.num.sqrt(sum(x * x for x in vector))


def lines(problem: dict[str, Any]) -> Iterator[Line]:
    """Yield every constraint of a problem with spheres, boxes, capsules, half-spaces, and no distortion."""
    for i, obstacle in enumerate(problem.get("obstacles", ())):
        yield from _obstacle(problem, i, obstacle)
    for side, sign in (("min", 1), ("max", -1)):
        for k, bound in enumerate((problem.get("workspace") or {}).get(side, ())):
            name = f"workspace {'xyz'[k]} {side}"
            yield Line(name, "m", False, lambda v, k=k, s=sign, b=bound: s * (v.t[k] - b), abs(bound))
    yield Line("rotation", "1", False, lambda v: sum(p * p for p in v.phi) - v.num.sqrt(1) / 100, 0.01)
    least = problem.get("least_distance", 1e-3)

    def apart(v: View) -> Any:
        return length(v, [a - b for a, b in zip(v.h, v.t, strict=True)]) - least

    yield Line("least_distance", "m", True, apart, least)
    yield from _image(problem["camera"], problem.get("visibility_margin", 0.0))


def _obstacle(problem: dict[str, Any], i: int, o: dict[str, Any]) -> Iterator[Line]:
    own = o.get("clearance")
    own = problem.get("clearance", 0.0) if own is None else own
    kind, radius = o["type"], o.get("radius", 0.0)
    if kind == "half_space":
        yield Line(f"clearance obstacle {i}", "m", False, lambda v: _beyond(v, o) - own, own)
        return
    apart = {"sphere": _from_sphere, "capsule": _from_capsule, "box": _from_box}[kind]
    yield Line(f"clearance obstacle {i}", "m", False, lambda v: apart(v, o, v.t) - radius - own, radius + own)
    if problem.get("occlusion", False) and not (kind == "sphere" and radius == 0):
        name = f"occlusion obstacle {i}"
        if kind == "sphere":
            yield Line(name, "m", True, lambda v: _to_segment(v, o["center"], v.t, v.h) - radius, radius)
        else:
            yield Line(name, "m", True, lambda v: _sight(v, lambda x: apart(v, o, x)) - radius, radius)


def _beyond(v: View, o: dict[str, Any]) -> Any:
    n = [0 * v.w + x for x in o["normal"]]
    return sum(a * b for a, b in zip(n, v.t, strict=True)) / length(v, n) - o["offset"]


def _from_sphere(v: View, o: dict[str, Any], x: Numbers) -> Any:
    return length(v, [a - b for a, b in zip(x, o["center"], strict=True)])


def _from_capsule(v: View, o: dict[str, Any], x: Numbers) -> Any:
    return _to_segment(v, x, *([0 * v.w + a for a in o[end]] for end in ("from", "to")))


def _to_segment(v: View, x: Numbers, start: Numbers, end: Numbers) -> Any:
    along = [b - a for a, b in zip(start, end, strict=True)]
    away = [a - b for a, b in zip(x, start, strict=True)]
    share = sum(a * b for a, b in zip(away, along, strict=True)) / sum(a * a for a in along)
    share = min(max(share, 0), 1)
    return length(v, [a - share * b for a, b in zip(away, along, strict=True)])


def _from_box(v: View, o: dict[str, Any], x: Numbers) -> Any:
    turned = View(v.num, v.w, [0 * v.w + q for q in o["quaternion"]], [0 * v.w + c for c in o["center"]], x)
    beyond = [abs(y) - e for y, e in zip(in_camera(turned), o["half_extents"], strict=True)]
    if max(beyond) <= 0:
        return max(beyond)
    return length(v, [max(b, 0 * v.w) for b in beyond])


def _sight(v: View, apart: Callable[[Numbers], Any]) -> Any:
    """Return the least of a convex distance along the line of sight, by golden section."""
    low, high = 0 * v.w, 0 * v.w + 1

    def at(share: Any) -> Any:
        return apart([a + share * (b - a) for a, b in zip(v.t, v.h, strict=True)])

    golden = (v.num.sqrt(0 * v.w + 5) - 1) / 2
    inner = [high - golden * (high - low), low + golden * (high - low)]
    values = [at(s) for s in inner]
    for _ in range(40 if v.num is math else 60):
        k = 0 if values[0] <= values[1] else 1
        low, high = (low, inner[1]) if k == 0 else (inner[0], high)
        new = high - golden * (high - low) if k == 0 else low + golden * (high - low)
        inner = [new, inner[0]] if k == 0 else [inner[1], new]
        values = [at(new), values[0]] if k == 0 else [values[1], at(new)]
    return min(*values, at(0), at(1))


def _image(camera: dict[str, Any], inset: float) -> Iterator[Line]:
    xi = camera["xi"]
    kappa = xi if xi <= 1 else None

    def domain(v: View) -> Any:
        x, y, z = in_camera(v)
        widest = v.num.acos(-kappa + 0 * v.w) if kappa is not None else v.num.acos(-1 / (xi + 0 * v.w))
        return widest - v.num.atan2(v.num.sqrt(x * x + y * y), z)

    yield Line("domain", "rad", True, domain, 1.0)
    for name, coordinate, sign, edge in (
        ("left edge", 0, 1, -0.5),
        ("right edge", 0, -1, camera["width"] - 0.5),
        ("top edge", 1, 1, -0.5),
        ("bottom edge", 1, -1, camera["height"] - 0.5),
    ):

        def inside(v: View, k: int = coordinate, s: int = sign, e: float = edge) -> Any:
            return s * (pixel(v, camera)[k] - e) - inset

        yield Line(f"visibility {name}", "px", True, inside, max(inset, 1.0))
    if camera.get("max_angle") is not None:
        yield Line("visibility max_angle", "px", True, lambda v: _rim(v, camera) - inset, max(inset, 1.0))
    if camera.get("dead_zone") is not None:
        zone = camera["dead_zone"]

        def outside(v: View) -> Any:
            away = [a - b for a, b in zip(pixel(v, camera), zone["center"], strict=True)]
            return length(v, away) - zone["radius"] - inset

        yield Line("dead_zone", "px", True, outside, max(inset, zone["radius"]))


def plane(v: View, camera: dict[str, Any]) -> Numbers:
    """Return m̄."""
    x, y, z = in_camera(v)
    depth = z + camera["xi"] * length(v, [x, y, z])
    return [x / depth, y / depth]


def pixel(v: View, camera: dict[str, Any]) -> Numbers:
    """Return (u, v)."""
    x, y = plane(v, camera)
    return [
        camera["fx"] * x + camera.get("skew", 0.0) * y + camera["cx"],
        camera["fy"] * y + camera["cy"],
    ]


def _rim(v: View, camera: dict[str, Any]) -> Any:
    angle, xi = 0 * v.w + camera["max_angle"], camera["xi"]
    rim = v.num.sin(angle) / (v.num.cos(angle) + xi)
    fx, fy, s = (0 * v.w + camera.get(name, 0.0) for name in ("fx", "fy", "skew"))
    trace, product = fx * fx + fy * fy + s * s, (fx * fy) ** 2
    stretch = v.num.sqrt((trace - v.num.sqrt(trace * trace - 4 * product)) / 2)
    return (rim - length(v, plane(v, camera))) * stretch
