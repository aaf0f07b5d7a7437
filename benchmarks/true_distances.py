"""Distances of a camera centre, and of a line of sight, from obstacles: by definition, part by part.

A cloud is its points; a mesh the faces and edges of the hull that Qhull finds. A part is a line of its own.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from functools import partial
from typing import Any

import numpy as np
from benchmarks.true_views import Line, Numbers, View, cross, dot, exact, in_camera, length, minus
from scipy.spatial import ConvexHull

Solid = dict[str, Any]
Part = Callable[[View, Numbers, Numbers], Any]
"""The distance of the segment between two points; the points may be one and the same."""


def obstacle_lines(problem: dict[str, Any], i: int, o: Solid) -> Iterator[Line]:
    """Yield clearance and occlusion of one obstacle."""
    own = o.get("clearance")
    own = problem.get("clearance", 0.0) if own is None else own
    kind, radius, motion = o["type"], o.get("radius", 0.0), o.get("motion") or ()
    name = f"clearance obstacle {i}"
    if kind == "half_space":
        yield Line(name, "m", False, lambda v: beyond(v, o) - own, own, motion)
        return
    for part in parts(o):
        yield Line(name, "m", False, partial(_apart, part, radius + own), radius + own, motion)
    if problem.get("occlusion", False) and not (kind in ("sphere", "cloud") and radius == 0):
        for part in parts(o):
            yield Line(f"occlusion obstacle {i}", "m", True, partial(_sight, part, radius), radius, motion)


def _apart(part: Part, asked: float, v: View) -> Any:
    return part(v, v.t, v.t) - asked


def _sight(part: Part, asked: float, v: View) -> Any:
    return part(v, v.t, v.h) - asked


def beyond(v: View, side: Solid) -> Any:
    """Return n·t/‖n‖ − offset of a half-space."""
    n = exact(v, side["normal"])
    return dot(n, v.t) / length(v, n) - side["offset"]


def parts(o: Solid) -> list[Part]:
    """Return the distances whose least is that from the obstacle's core."""
    if o["type"] == "sphere":
        return [partial(_from_point, o["center"])]
    if o["type"] == "cloud":
        return [partial(_from_point, p) for p in o["points"]]
    if o["type"] == "capsule":
        return [partial(_from_edge, o["from"], o["to"])]
    return [partial(_from_box, o)] if o["type"] == "box" else _mesh(o["vertices"])


def _mesh(vertices: list[list[float]]) -> list[Part]:
    points = np.array(vertices)
    faces = []
    for a, b, c in ConvexHull(points).simplices:
        normal = np.cross(points[b] - points[a], points[c] - points[a])
        outward = normal @ (points.mean(axis=0) - points[a]) < 0
        faces.append([vertices[k] for k in ((a, b, c) if outward else (a, c, b))])
    edges = {tuple(sorted(map(tuple, (f[k - 1], f[k])))) for f in faces for k in range(3)}
    return [
        *(partial(_from_edge, start, end) for start, end in sorted(edges)),
        *(partial(_from_face, face) for face in faces),
        partial(_through, faces),
    ]


def _from_point(center: list[float], v: View, start: Numbers, end: Numbers) -> Any:
    return _to_segment(v, exact(v, center), start, end)


def _to_segment(v: View, x: Numbers, start: Numbers, end: Numbers) -> Any:
    along, away = minus(end, start), minus(x, start)
    squared = dot(along, along)
    share = min(max(dot(away, along) / squared, 0), 1) if squared > 0 else 0
    return length(v, [a - share * b for a, b in zip(away, along, strict=True)])


def _from_edge(first: list[float], last: list[float], v: View, start: Numbers, end: Numbers) -> Any:
    """Two segments: at an end of one of them, or where the common perpendicular meets both."""
    a, b = exact(v, first), exact(v, last)
    ends = [_to_segment(v, start, a, b)]
    if start is end:
        return ends[0]
    ends += [_to_segment(v, end, a, b), _to_segment(v, a, start, end), _to_segment(v, b, start, end)]
    p, q, r = minus(b, a), minus(end, start), minus(start, a)
    pp, qq, pq = dot(p, p), dot(q, q), dot(p, q)
    det = pp * qq - pq * pq
    if det > 0:
        s, u = (qq * dot(p, r) - pq * dot(q, r)) / det, (pq * dot(p, r) - pp * dot(q, r)) / det
        if 0 <= s <= 1 and 0 <= u <= 1:
            ends.append(length(v, [x + u * y - s * z for x, y, z in zip(r, q, p, strict=True)]))
    return min(ends)


def _from_face(face: list[list[float]], v: View, start: Numbers, end: Numbers) -> Any:
    """The height of the nearer end above the face; infinite where none is above it."""
    a, b, c = (exact(v, corner) for corner in face)
    n = cross(minus(b, a), minus(c, a))
    found = [math.inf]
    for x in (start,) if start is end else (start, end):
        sides = ((a, b), (b, c), (c, a))
        if all(dot(n, cross(minus(q, p), minus(x, p))) >= 0 for p, q in sides):
            found.append(abs(dot(n, minus(x, a))) / length(v, n))
    return min(found)


def _through(faces: list[list[list[float]]], v: View, start: Numbers, end: Numbers) -> Any:
    """Minus the share of the segment inside all faces, of a point its depth; infinite where none is."""
    low, high, depth = 0 * v.w, 0 * v.w + 1, -math.inf
    for corners in faces:
        a, b, c = (exact(v, corner) for corner in corners)
        n = cross(minus(b, a), minus(c, a))
        first, last = dot(n, minus(start, a)), dot(n, minus(end, a))
        if first >= 0 and last >= 0:
            return math.inf
        depth = max(depth, first / length(v, n))
        if first >= 0:
            low = max(low, first / (first - last))
        elif last > 0:
            high = min(high, first / (first - last))
    return depth if start is end else low - high if high > low else math.inf


def _from_box(o: Solid, v: View, start: Numbers, end: Numbers) -> Any:
    if start is end:
        return _point_from_box(o, v, start)
    return _least(v, lambda x: _point_from_box(o, v, x), start, end)


def _point_from_box(o: Solid, v: View, x: Numbers) -> Any:
    turned = View(v.num, v.w, exact(v, o["quaternion"]), exact(v, o["center"]), x)
    beyond_faces = [abs(y) - e for y, e in zip(in_camera(turned), o["half_extents"], strict=True)]
    if max(beyond_faces) <= 0:
        return max(beyond_faces)
    return length(v, [max(b, 0 * v.w) for b in beyond_faces])


def _least(v: View, apart: Callable[[Numbers], Any], start: Numbers, end: Numbers) -> Any:
    """Return the least of a convex distance along the line of sight, by golden section."""
    low, high = 0 * v.w, 0 * v.w + 1

    def at(share: Any) -> Any:
        return apart([a + share * (b - a) for a, b in zip(start, end, strict=True)])

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
