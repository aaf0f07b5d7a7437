"""Convex parts of mesh files."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from scipy.spatial import ConvexHull

from omniservo.errors import InputError
from omniservo.files.mesh_files import read_triangles
from omniservo.geometry.arrays import FloatArray, IntArray
from omniservo.planning.obstacles.hull_shape import MOST_VERTICES, convex_hull

MOST_PARTS = 1000
"""Convex parts of one file."""

DENT = 1e-4
"""A part counts as convex where nothing of its surface lies deeper inside its hull than this part of its
extent. The obstacle is the hull, which holds the whole part."""


def read_mesh(path: Path) -> list[FloatArray]:
    """Return the corners (n, 3) of every convex part of an STL (text or binary), OBJ or COLLADA file.

    Vertices of equal coordinates are one. Materials, textures and whatever else the file names are not read.

    Raises:
        InputError: not readable, above 16 MiB, not of these formats, not finite, or a part that is not
            closed or not convex, with the place and the depth.
    """
    from scipy.sparse import coo_array
    from scipy.sparse.csgraph import connected_components  # slow to import, and few problems have meshes

    vertices, faces = read_triangles(path)
    vertices, merged = np.unique(vertices, axis=0, return_inverse=True)
    faces = merged.reshape(-1)[faces]
    distinct = (faces[:, 0] != faces[:, 1]) & (faces[:, 1] != faces[:, 2]) & (faces[:, 2] != faces[:, 0])
    faces = faces[distinct]
    if len(faces) == 0:
        raise InputError(f"{path}: no triangle with an area in it")
    edges = np.sort(np.concatenate([faces[:, [0, 1]], faces[:, [1, 2]], faces[:, [2, 0]]]), axis=1)
    size = len(vertices)
    graph = coo_array((np.ones(len(edges), dtype=np.int8), (edges[:, 0], edges[:, 1])), shape=(size, size))
    _, part_of = connected_components(graph, directed=False)
    parts = np.unique(part_of[faces[:, 0]])
    if len(parts) > MOST_PARTS:
        raise InputError(f"{path}: {len(parts)} separate parts; legal: at most {MOST_PARTS}")
    return [
        _convex_part(f"{path}: part {k} of {len(parts)}", vertices, faces[part_of[faces[:, 0]] == part])
        for k, part in enumerate(parts)
    ]


def _convex_part(name: str, vertices: FloatArray, faces: IntArray) -> FloatArray:
    """Return the corners of the hull of a closed convex surface, given by all vertices and its triangles."""
    edges = np.sort(np.concatenate([faces[:, [0, 1]], faces[:, [1, 2]], faces[:, [2, 0]]]), axis=1)
    _, uses = np.unique(edges, axis=0, return_counts=True)
    if np.any(uses != 2):
        raise InputError(
            f"{name} is not closed: {np.count_nonzero(uses != 2)} of its {len(uses)} edges do not belong to "
            "two triangles; legal: closed convex parts"
        )
    own = vertices[np.unique(faces)]
    corners = convex_hull(name, own).corners
    if len(corners) > MOST_VERTICES:
        raise InputError(f"{name}: a hull of {len(corners)} corners; legal: at most {MOST_VERTICES}")
    extent = float(np.ptp(own, axis=0).max())
    surface = np.concatenate([own, vertices[faces].mean(axis=1)])
    depths = _depths(ConvexHull(corners), surface)
    deepest = int(np.argmax(depths))
    if depths[deepest] > DENT * extent:
        what = "vertex" if deepest < len(own) else "triangle around"
        place = ", ".join(f"{x:.6g}" for x in surface[deepest])
        raise InputError(
            f"{name} is not convex: its {what} ({place}) lies {depths[deepest]:.3g} inside its hull, of an "
            f"extent of {extent:.3g}; legal: closed convex parts: decompose it, for example with CoACD, and "
            "give the parts"
        )
    return corners


def _depths(hull: ConvexHull, points: FloatArray) -> FloatArray:
    """Return how deep points (n, 3) lie inside a hull, in blocks that bound the memory."""
    block = max(1, 2_000_000 // len(hull.equations))
    rows = [
        (points[k : k + block] @ hull.equations[:, :3].T + hull.equations[:, 3]).max(axis=1)
        for k in range(0, len(points), block)
    ]
    depths: FloatArray = -np.concatenate(rows)
    return depths
