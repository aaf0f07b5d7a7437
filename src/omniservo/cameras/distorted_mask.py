"""A mask of a distorted camera, covered by a convex polygon of the undistorted image K m.

With V the convex polygon of the plane m that a plan keeps to and P a mask's polygon, grown by the margin:
`mask_on_plane` gives lines; where m in V has K m beyond one of them, D(m) is outside P.

Proof: what V has beyond a line is convex. It is cut into triangles; on each the image D(m) is a form of
degree 5 whose Bernstein coefficients lie beyond one edge of P, or it is halved.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np
from scipy.spatial import ConvexHull, QhullError

from omniservo.cameras.image_mask import Corner, outward_edges
from omniservo.errors import InputError
from omniservo.geometry.arrays import BoolArray, FloatArray

if TYPE_CHECKING:
    from omniservo.cameras.unified_camera import UnifiedCamera

_BEYOND_PX = (0.03, 0.1, 0.3, 1.0, 3.0)
"""so far the lines are moved outward, until the proof succeeds"""
_STRAIGHT_PX = 0.05
"""corners of the cover so near to their neighbours' line are left out"""
_TOLERANCE_PX = 1e-7
"""far above the rounding of the Bernstein coefficients, about 1e-11 px"""
_STEPS = 128
"""places on each side of a polygon"""
_MOST_TRIANGLES = 200_000
_DEGREE = 5


def mask_on_plane(
    camera: UnifiedCamera, corners: Sequence[Corner], margin_px: float, region: FloatArray
) -> FloatArray | None:
    """Return lines (k, 3), unit n and b [px] in K m, of the cover; None where V shows nothing of the mask.

    Args:
        camera: with distortion.
        corners: of the mask's polygon [px].
        margin_px: by which it grows.
        region: V, corners (k, 2) of a convex polygon on the plane m, on which D is one-to-one.

    Raises:
        InputError: no such lines could be proven.
    """
    grown = outward_edges(corners, margin_px)
    straight = region @ camera.matrix[:2, :2].T + camera.matrix[:2, 2]
    hidden = _border_of_hidden_part(camera, grown, region)
    if len(hidden) == 0:
        if _shows_nothing(camera, [straight], grown):
            return None
        hidden = straight
    lines = _hull_lines(hidden)
    for beyond in _BEYOND_PX:
        moved = np.asarray(lines + np.array([0.0, 0.0, beyond]), dtype=np.float64)
        parts = [part for line in moved if (part := _beyond(straight, line)) is not None]
        if _shows_nothing(camera, parts, grown):
            return moved
    raise InputError("mask: no cover of its place on the undistorted image could be proven")


def _border_of_hidden_part(camera: UnifiedCamera, grown: FloatArray, region: FloatArray) -> FloatArray:
    """Return places (k, 2) [px of K m] round the part of V that is seen in the mask."""
    t = np.linspace(0.0, 1.0, _STEPS, endpoint=False)[:, None]
    border = _sides(_corners(grown), t)
    bearings, valid = camera.unproject(border)
    m = bearings[valid, :2] / (bearings[valid, 2:] + camera.xi)
    inside = m[_left_of_all(region, m)]
    sides = _sides(region, t)
    seen = distort(camera, sides)
    rim = sides[(seen @ grown[:, :2].T < grown[:, 2]).all(axis=1)]
    return np.vstack([inside, rim]) @ camera.matrix[:2, :2].T + camera.matrix[:2, 2]


def _corners(lines: FloatArray) -> FloatArray:
    """Return where neighbouring lines meet."""
    after = np.roll(lines, -1, axis=0)
    pairs = np.stack([lines[:, :2], after[:, :2]], axis=1)
    offsets = np.stack([lines[:, 2], after[:, 2]], axis=1)
    return np.asarray(np.linalg.solve(pairs, offsets[..., None])[..., 0])


def _sides(polygon: FloatArray, t: FloatArray) -> FloatArray:
    """Return places (sides · steps, 2) along the sides."""
    along = np.roll(polygon, -1, axis=0) - polygon
    return np.asarray((polygon[:, None] + t * along[:, None]).reshape(-1, 2))


def _left_of_all(polygon: FloatArray, points: FloatArray) -> BoolArray:
    """Tell which points (k, 2) lie in a convex polygon, counter-clockwise."""
    along = np.roll(polygon, -1, axis=0) - polygon
    normals = np.column_stack([-along[:, 1], along[:, 0]])
    inside: BoolArray = (points @ normals.T >= np.einsum("ij,ij->i", normals, polygon)).all(axis=1)
    return inside


def _hull_lines(points: FloatArray) -> FloatArray:
    """Return lines that have every point on their inner side, few where the hull is nearly straight."""
    try:
        hull = points[ConvexHull(points).vertices]
    except QhullError:  # all on one line
        low, high = points.min(axis=0) - _STRAIGHT_PX, points.max(axis=0) + _STRAIGHT_PX
        hull = np.array([low, [high[0], low[1]], high, [low[0], high[1]]])
    chosen = hull[_far_from_chords(hull)]
    lines = outward_edges([(u, v) for u, v in chosen.tolist()])
    return np.column_stack([lines[:, :2], (hull @ lines[:, :2].T).max(axis=0)])


def _far_from_chords(hull: FloatArray) -> list[int]:
    """Return places of corners such that no other is farther than `_STRAIGHT_PX` from their outline."""
    far = int(np.argmax(np.hypot(*(hull - hull[0]).T)))
    pending, chosen = [(0, far), (far, len(hull))], {0, far}
    while pending:
        start, end = pending.pop()
        along = hull[end % len(hull)] - hull[start]
        between = hull[start + 1 : end] - hull[start]
        away = np.abs(along[0] * between[:, 1] - along[1] * between[:, 0]) / max(math.hypot(*along), 1e-300)
        if len(away) and (away.max() > _STRAIGHT_PX or len(chosen) < 3):
            middle = start + 1 + int(away.argmax())
            chosen.add(middle)
            pending += [(start, middle), (middle, end)]
    return sorted(chosen)


def _beyond(polygon: FloatArray, line: FloatArray) -> FloatArray | None:
    """Return the part of a convex polygon where n·p ≥ b; None where there is none."""
    values = polygon @ line[:2] - line[2]
    if values.max() <= 0.0:
        return None
    kept = []
    for i in range(len(polygon)):
        here, there = values[i], values[(i + 1) % len(polygon)]
        if here >= 0.0:
            kept.append(polygon[i])
        if (here < 0.0) != (there < 0.0):
            t = here / (here - there)
            kept.append(polygon[i] + t * (polygon[(i + 1) % len(polygon)] - polygon[i]))
    return np.array(kept) if len(kept) > 2 else None


def _shows_nothing(camera: UnifiedCamera, parts: Sequence[FloatArray], grown: FloatArray) -> bool:
    """Prove that convex parts of K m (k, 2) have images beyond an edge of the mask; False where it fails."""
    fans = [np.stack([np.tile(p[0], (len(p) - 2, 1)), p[1:-1], p[2:]], axis=1) for p in parts]
    pending = np.concatenate(fans) if fans else np.zeros((0, 3, 2))
    inverse, offset = np.linalg.inv(camera.matrix[:2, :2]), camera.matrix[:2, 2]
    lattice, matrix = _LATTICE, _FROM_SAMPLES
    done = 0
    while len(pending):
        done += len(pending)
        if done > _MOST_TRIANGLES:
            return False
        samples = distort(camera, (np.einsum("sk,tkc->tsc", lattice, pending) - offset) @ inverse.T)
        if (samples @ grown[:, :2].T < grown[:, 2]).all(axis=2).any():
            return False
        coefficients = np.einsum("is,tsc->tic", matrix, samples) @ grown[:, :2].T - grown[:, 2]
        proven = (coefficients.min(axis=1) >= _TOLERANCE_PX).any(axis=1)
        pending = _halved(pending[~proven])
    return True


def _halved(triangles: FloatArray) -> FloatArray:
    """Return both halves of each triangle (t, 3, 2), cut through the middle of its longest side."""
    lengths = np.linalg.norm(np.roll(triangles, -1, axis=1) - triangles, axis=2)
    first = np.argmax(lengths, axis=1)
    rows = np.arange(len(triangles))
    a, b, c = (triangles[rows, (first + k) % 3] for k in range(3))
    middle = 0.5 * (a + b)
    return np.concatenate([np.stack([a, middle, c], axis=1), np.stack([middle, b, c], axis=1)])


def distort(camera: UnifiedCamera, m: FloatArray) -> FloatArray:
    """Return the pixels of plane points (…, 2), without any check."""
    k1, k2, p1, p2 = camera.distortion
    x, y = m[..., 0], m[..., 1]
    r2 = x * x + y * y
    factor = 1.0 + r2 * (k1 + r2 * k2) + 2.0 * (p2 * x + p1 * y)
    dx, dy = x * factor + p2 * r2, y * factor + p1 * r2
    return np.stack([camera.fx * dx + camera.skew * dy + camera.cx, camera.fy * dy + camera.cy], axis=-1)


def _triangle_basis() -> tuple[FloatArray, FloatArray]:
    """Return the 21 lattice places of a triangle, barycentric, and the matrix from values to coefficients."""
    n = _DEGREE
    powers = [(i, j, n - i - j) for i in range(n + 1) for j in range(n + 1 - i)]
    lattice = np.array(powers) / n
    counts = [math.factorial(n) / math.prod(map(math.factorial, p)) for p in powers]
    values = [
        [c * math.prod(x**k for x, k in zip(at, p, strict=True)) for c, p in zip(counts, powers, strict=True)]
        for at in lattice
    ]
    return lattice, np.linalg.inv(np.array(values))


_LATTICE, _FROM_SAMPLES = _triangle_basis()
