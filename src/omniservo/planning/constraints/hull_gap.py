"""How far a segment is from the convex hull of vertices, and how deep inside it.

The least ‖x‖ over differences x of a point of the segment and a point of the hull is approached by Wolfe's
algorithm (P. Wolfe, Finding the nearest point in a polytope, 1976): x is the point nearest to 0 of the hull
of at most four differences; the difference that lies least far along x joins them until none is nearer. A
segment that meets the hull is pushed out along a face's normal, or across the segment and an edge.
"""

import math
from typing import NamedTuple

import numpy as np

from omniservo.geometry.arrays import FloatArray
from omniservo.geometry.kernel import kernel, leaf

_MOST_STEPS = 100
"""Joining differences; each step makes x shorter, so it ends before."""

_NEAREST = 1e-14
"""A difference must be nearer by this part of ‖x‖² and of the sizes to join."""

_TOUCHING = 1e-14
"""Below this part of the coordinates x is only rounding."""

_SAFE_SIDE = 1e-12
"""Depths are stated less by this part of the coordinates: a face's normal is rounded."""


ALONG, ONE, OTHER = 3, 6, 9
"""Where in a row of `Hull.edges` the direction and the normals of the two faces start; the point is first."""


class Hull(NamedTuple):
    """The convex hull of vertices; without vertices no hull."""

    corners: FloatArray
    """vertices (V, 3) [m]"""
    faces: FloatArray
    """(F, 4): outward unit n, and b of n·x ≤ b"""
    edges: FloatArray
    """(E, 12): a point, the direction along the edge, the normals of its two faces"""


@leaf
def support(corners: FloatArray, x: float, y: float, z: float) -> tuple[float, int]:
    """Return the greatest n·v over the vertices for n = (x, y, z), and the vertex."""
    most, found = -math.inf, 0
    for k in range(corners.shape[0]):
        along = x * corners[k, 0] + y * corners[k, 1] + z * corners[k, 2]
        if along > most:
            most, found = along, k
    return most, found


@kernel
def nearest_weights(points: FloatArray, count: int, weights: FloatArray) -> bool:
    """Write the weights, of sum 1, of the point nearest to 0 on the plane through ``count`` points (4, 3).

    At most four. They may be negative. False where the points are not affinely independent.
    """
    gram, right = np.empty((3, 3)), np.empty(3)
    m = count - 1
    for i in range(m):
        for j in range(i + 1):
            total = 0.0
            for c in range(3):
                total += (points[i + 1, c] - points[0, c]) * (points[j + 1, c] - points[0, c])
            gram[i, j] = total
        right[i] = 0.0
        for c in range(3):
            right[i] -= (points[i + 1, c] - points[0, c]) * points[0, c]
    for j in range(m):
        before = gram[j, j]
        for k in range(j):
            gram[j, j] -= gram[j, k] * gram[j, k]
        if not gram[j, j] > 1e-15 * before:
            return False
        gram[j, j] = math.sqrt(gram[j, j])
        for i in range(j + 1, m):
            for k in range(j):
                gram[i, j] -= gram[i, k] * gram[j, k]
            gram[i, j] /= gram[j, j]
    for i in range(m):
        for k in range(i):
            right[i] -= gram[i, k] * right[k]
        right[i] /= gram[i, i]
    rest = 1.0
    for i in range(m - 1, -1, -1):
        for k in range(i + 1, m):
            right[i] -= gram[k, i] * right[k]
        right[i] /= gram[i, i]
        weights[i + 1] = right[i]
        rest -= right[i]
    weights[0] = rest
    return True


@leaf
def drop_points(points: FloatArray, shares: FloatArray, weights: FloatArray, count: int) -> int:
    """Replace the points of ``weights`` 0 by those behind them; return how many are left."""
    left = 0
    for k in range(count):
        if weights[k] > 0.0:
            for c in range(3):
                points[left, c] = points[k, c]
            shares[left], weights[left] = shares[k], weights[k]
            left += 1
    return left


@leaf
def shorten(points: FloatArray, shares: FloatArray, weights: FloatArray, count: int, room: FloatArray) -> int:
    """Move the weights to the point nearest to 0 of the hull of ``count`` points; return how many are left.

    From weights ≥ 0 it goes straight to `nearest_weights`; a point whose weight becomes 0 on the way is
    dropped.
    """
    for _ in range(4):
        if count == 1 or not nearest_weights(points, count, room):
            return count
        step = 1.0
        for k in range(count):
            if room[k] < 0.0:
                step = min(step, weights[k] / (weights[k] - room[k]))
        total = 0.0
        for k in range(count):
            moved = weights[k] + step * (room[k] - weights[k])
            gone = step < 1.0 and room[k] < 0.0 and weights[k] / (weights[k] - room[k]) <= step
            weights[k] = 0.0 if gone else max(moved, 0.0)
            total += weights[k]
        for k in range(count):
            weights[k] /= total
        count = drop_points(points, shares, weights, count)
        if step == 1.0:
            return count
    return count


@kernel
def nearest_difference(
    corners: FloatArray, t: tuple[float, float, float], h: tuple[float, float, float]
) -> tuple[float, float, float, float]:
    """Return x, the shortest vector from hull to segment from t to h, and s: t + s(h − t) is its end."""
    points, shares, weights, room = np.empty((4, 3)), np.empty(4), np.empty(4), np.empty(4)
    for c in range(3):
        points[0, c] = t[c] - corners[0, c]
    shares[0], weights[0], count = 0.0, 1.0, 1
    x, y, z, square = points[0, 0], points[0, 1], points[0, 2], math.inf
    for _ in range(_MOST_STEPS):
        before, square = square, x * x + y * y + z * z
        if not square < before:
            break
        far, vertex = support(corners, x, y, z)
        at_t, at_h = x * t[0] + y * t[1] + z * t[2], x * h[0] + y * h[1] + z * h[2]
        along = min(at_t, at_h) - far
        if along >= square - _NEAREST * (square + abs(far) + abs(at_t)):
            break
        if count == 4:
            break
        for c in range(3):
            points[count, c] = (t[c] if at_t <= at_h else h[c]) - corners[vertex, c]
        shares[count], weights[count] = 0.0 if at_t <= at_h else 1.0, 0.0
        count = shorten(points, shares, weights, count + 1, room)
        x, y, z = 0.0, 0.0, 0.0
        for k in range(count):
            x += weights[k] * points[k, 0]
            y += weights[k] * points[k, 1]
            z += weights[k] * points[k, 2]
    part = 0.0
    for k in range(count):
        part += weights[k] * shares[k]
    return x, y, z, part


@leaf
def depth_in_hull(
    hull: Hull, t: tuple[float, float, float], h: tuple[float, float, float], s: float
) -> tuple[float, float, float, float, float]:
    """Return (unit direction, −depth, s): the shortest move that takes the segment out of the hull.

    Candidates are the faces' normals, and the directions across both the segment and an edge between a face
    that it enters by and one that it leaves by. s as in `depth_inside`.
    """
    depth, x, y, z, part = math.inf, 1.0, 0.0, 0.0, 0.0
    for k in range(hull.faces.shape[0]):
        n = hull.faces[k]
        start, end = n[0] * t[0] + n[1] * t[1] + n[2] * t[2], n[0] * h[0] + n[1] * h[1] + n[2] * h[2]
        if n[3] - min(start, end) < depth:
            depth, part = n[3] - min(start, end), (0.0 if start <= end else 1.0)
            x, y, z = n[0], n[1], n[2]
    dx, dy, dz = h[0] - t[0], h[1] - t[1], h[2] - t[2]
    if dx == 0.0 and dy == 0.0 and dz == 0.0:
        return x, y, z, -depth, part
    for k in range(hull.edges.shape[0]):
        p, e, a, b = hull.edges[k], hull.edges[k, ALONG:], hull.edges[k, ONE:], hull.edges[k, OTHER:]
        one, other = a[0] * dx + a[1] * dy + a[2] * dz, b[0] * dx + b[1] * dy + b[2] * dz
        if one * other > 0.0:
            continue
        nx, ny, nz = dy * e[2] - dz * e[1], dz * e[0] - dx * e[2], dx * e[1] - dy * e[0]
        norm = math.sqrt(nx * nx + ny * ny + nz * nz)
        if nx * (a[0] + b[0]) + ny * (a[1] + b[1]) + nz * (a[2] + b[2]) < 0.0:
            norm = -norm
        if norm != 0.0:
            nx, ny, nz = nx / norm, ny / norm, nz / norm
            size = nx * (p[0] - t[0]) + ny * (p[1] - t[1]) + nz * (p[2] - t[2])
            if size < depth:
                depth, part, x, y, z = size, s, nx, ny, nz
    return x, y, z, -depth, part


@leaf
def hull_gap(
    hull: Hull, t: tuple[float, float, float], h: tuple[float, float, float]
) -> tuple[float, float, float, float, float]:
    """Return (unit direction n, gap, s) from the hull to the segment from t to h.

    The gap is their distance, never less than the true one but for rounding, or negative the depth, never
    more than the true one; t + s(h − t) is nearest.
    """
    x, y, z, s = nearest_difference(hull.corners, t, h)
    gap = math.sqrt(x * x + y * y + z * z)
    size = 0.0
    for c in range(3):
        size += abs(t[c]) + abs(h[c]) + abs(hull.corners[0, c])
    if gap > _TOUCHING * size:
        return x / gap, y / gap, z / gap, gap, s
    x, y, z, gap, s = depth_in_hull(hull, t, h, s)
    return x, y, z, min(gap + _SAFE_SIDE * size, 0.0), s
