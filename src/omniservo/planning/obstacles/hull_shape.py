"""The convex hull of points, with its faces and edges."""

from __future__ import annotations

import numpy as np
from scipy.spatial import ConvexHull, QhullError

from omniservo.errors import InputError
from omniservo.geometry.arrays import FloatArray
from omniservo.planning.constraints.hull_gap import Hull

MOST_VERTICES = 1000
"""Corners that the hull of a mesh may have."""

FLAT = 1e-9
"""Points nearer to one plane than this part of their extent have no volume."""


def convex_hull(name: str, points: FloatArray) -> Hull:
    """Return the convex hull of points (n, 3), its vertices in their order among the points.

    Raises:
        InputError: fewer than 4 points, or all of them in one plane.
    """
    if len(points) < 4:
        raise InputError(f"{name}: {len(points)} given; legal: at least 4, not all in one plane")
    extent = float(np.ptp(points, axis=0).max())
    flat = InputError(f"{name}: all within {FLAT * extent:.3g} m of one plane; a solid is needed")
    while True:
        try:
            found = ConvexHull(points)
        except QhullError:
            raise flat from None
        if len(found.vertices) == len(points):
            break
        points = points[np.sort(found.vertices)]
    normals = np.unique(found.equations[:, :3], axis=0)
    heights = points @ normals.T
    if np.ptp(heights, axis=0).min() <= FLAT * extent:
        raise flat
    faces = np.column_stack([normals, heights.max(axis=0)])
    return Hull(np.array(points, order="C"), faces, _edges(found))


def _edges(found: ConvexHull) -> FloatArray:
    """Return the edges of triangles (E, 12), see `Hull`, without those inside a flat face."""
    rows = []
    for corner in range(3):
        first, second = found.simplices[:, (corner + 1) % 3], found.simplices[:, (corner + 2) % 3]
        here, there = np.arange(len(found.simplices)), found.neighbors[:, corner]
        normals, others = found.equations[:, :3], found.equations[there, :3]
        own = (here < there) & ~np.all(normals == others, axis=1)
        start, end = found.points[first[own]], found.points[second[own]]
        rows.append(np.hstack([start, end - start, normals[own], others[own]]))
    return np.ascontiguousarray(np.concatenate(rows))
