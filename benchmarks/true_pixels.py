"""Where target points stand in the image, and what is left to its limits, by the camera's formula."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

from benchmarks.true_views import Line, Numbers, View, in_camera, length

Camera = dict[str, Any]


def image_lines(camera: Camera, inset: float) -> Iterator[Line]:
    """Yield domain, edges, circle, dead zone and masks; of a distorted camera the edges are one line.

    A distorted camera's circle is left out: its margin is at most that of the edges.
    """
    yield _domain(camera)
    distorted = any(camera.get("distortion") or ())
    asked = max(inset, 1.0)
    for name, coordinate, sign, edge in (
        ("left edge", 0, 1, -0.5),
        ("right edge", 0, -1, camera["width"] - 0.5),
        ("top edge", 1, 1, -0.5),
        ("bottom edge", 1, -1, camera["height"] - 0.5),
    ):

        def inside(v: View, k: int = coordinate, s: int = sign, e: float = edge) -> Any:
            return s * (pixel(v, camera)[k] - e) - inset

        yield Line(f"visibility {'polygon' if distorted else name}", "px", True, inside, asked)
    if camera.get("max_angle") is not None and not distorted:
        yield Line("visibility max_angle", "px", True, lambda v: _rim(v, camera) - inset, asked)
    if camera.get("dead_zone") is not None:
        zone = camera["dead_zone"]

        def outside(v: View) -> Any:
            away = [a - b for a, b in zip(pixel(v, camera), zone["center"], strict=True)]
            return length(v, away) - zone["radius"] - inset

        yield Line("dead_zone", "px", True, outside, max(inset, zone["radius"]))
    for i, corners in enumerate(camera.get("mask") or ()):

        def beyond(v: View, corners: list[list[float]] = corners) -> Any:
            return _beyond(v, pixel(v, camera), corners) - inset

        yield Line(f"visibility mask {i}", "px", True, beyond, asked)


def _domain(camera: Camera) -> Line:
    xi = camera["xi"]

    def left(v: View) -> Any:
        x, y, z = in_camera(v)
        widest = v.num.acos(-xi + 0 * v.w) if xi <= 1 else v.num.acos(-1 / (xi + 0 * v.w))
        return widest - v.num.atan2(v.num.sqrt(x * x + y * y), z)

    return Line("domain", "rad", True, left, 1.0)


def _beyond(v: View, at: Numbers, corners: list[list[float]]) -> Any:
    """Return how far the pixel is beyond the edge of a convex polygon that it is farthest beyond."""
    flat = [[0 * v.w + x for x in corner] for corner in corners]
    (ax, ay), (bx, by), (cx, cy) = flat[:3]
    turn = 1 if (bx - ax) * (cy - by) > (by - ay) * (cx - bx) else -1
    found = []
    for (x, y), (u, w) in zip(flat, [*flat[1:], flat[0]], strict=True):
        n = [turn * (w - y), turn * (x - u)]
        found.append((n[0] * (at[0] - x) + n[1] * (at[1] - y)) / length(v, n))
    return max(found)


def plane(v: View, camera: Camera) -> Numbers:
    """Return m̄, without distortion."""
    x, y, z = in_camera(v)
    depth = z + camera["xi"] * length(v, [x, y, z])
    return [x / depth, y / depth]


def pixel(v: View, camera: Camera) -> Numbers:
    """Return (u, v)."""
    x, y = plane(v, camera)
    if any(camera.get("distortion") or ()):
        k1, k2, p1, p2 = (0 * v.w + k for k in camera["distortion"])
        s = x * x + y * y
        radial = 1 + k1 * s + k2 * s * s
        x, y = (
            x * radial + 2 * p1 * x * y + p2 * (s + 2 * x * x),
            y * radial + p1 * (s + 2 * y * y) + 2 * p2 * x * y,
        )
    return [
        camera["fx"] * x + camera.get("skew", 0.0) * y + camera["cx"],
        camera["fy"] * y + camera["cy"],
    ]


def _rim(v: View, camera: Camera) -> Any:
    angle, xi = 0 * v.w + camera["max_angle"], camera["xi"]
    rim = v.num.sin(angle) / (v.num.cos(angle) + xi)
    fx, fy, s = (0 * v.w + camera.get(name, 0.0) for name in ("fx", "fy", "skew"))
    trace, product = fx * fx + fy * fy + s * s, (fx * fy) ** 2
    stretch = v.num.sqrt((trace - v.num.sqrt(trace * trace - 4 * product)) / 2)
    return (rim - length(v, plane(v, camera))) * stretch
