"""Convex parts of STL and OBJ files."""

from __future__ import annotations

import io
import warnings
from pathlib import Path
from typing import Any

import numpy as np
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components
from scipy.spatial import ConvexHull

from omniservo.errors import InputError
from omniservo.files import read_bytes
from omniservo.geometry.arrays import FloatArray, IntArray
from omniservo.planning.obstacles.hull_shape import MOST_VERTICES, convex_hull

MOST_BYTES = 16 * 2**20
"""A larger file is not read."""

MOST_PARTS = 1000
"""Convex parts of one file."""

DENT = 1e-4
"""A part counts as convex where nothing of its surface lies deeper inside its hull than this part of its
extent. The obstacle is the hull, which holds the whole part."""


def read_mesh(path: Path) -> list[FloatArray]:
    """Return the corners (n, 3) of every convex part of an STL (text or binary) or OBJ file.

    Vertices of equal coordinates are one. Materials, textures and whatever else the file names are not read.

    Raises:
        InputError: not readable, above 16 MiB, not of these formats, not finite, or a part that is not
            closed or not convex, with the place and the depth.
    """
    vertices, faces = _triangles(path)
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


def _triangles(path: Path) -> tuple[FloatArray, IntArray]:
    """Return vertices (v, 3) and triangles (f, 3) of a file, as it has them."""
    kind = path.suffix.lower()
    if kind not in (".stl", ".obj"):
        raise InputError(f"{path}: {kind!r} given; legal: '.stl', '.obj'")
    content = io.BytesIO(read_bytes(path, max_bytes=MOST_BYTES))
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("error")  # NumPy warns where it stops in the middle of a text
            loaded = _load_stl(content) if kind == ".stl" else _load_obj(content)
        pieces = list(loaded["geometry"].values()) if "geometry" in loaded else [loaded]
        vertices = [np.asarray(p["vertices"], dtype=np.float64).reshape(-1, 3) for p in pieces]
        faces = [np.asarray(p.get("faces", np.zeros((0, 3))), dtype=np.int64).reshape(-1, 3) for p in pieces]
    except Exception as error:
        raise InputError(f"{path}: not {kind[1:].upper()} as far as can be read: {error!s:.80}") from None
    first = np.cumsum([0] + [len(v) for v in vertices])
    joined = np.concatenate([np.zeros((0, 3)), *vertices])
    shifted = [f + before for f, before in zip(faces, first[:-1], strict=True)]
    triangles = np.concatenate([np.zeros((0, 3), np.int64), *shifted])
    if len(triangles) == 0:
        raise InputError(f"{path}: no triangles in it")
    if not np.isfinite(joined).all():
        row = int(np.argwhere(~np.isfinite(joined).all(axis=1))[0, 0])
        raise InputError(f"{path}: vertex {row} is {joined[row].tolist()}; every number must be finite")
    if triangles.min() < 0 or triangles.max() >= len(joined):
        raise InputError(f"{path}: a triangle of vertex {triangles.max()}, but only {len(joined)} vertices")
    return joined, triangles


def _load_stl(content: io.BytesIO) -> dict[str, Any]:
    from trimesh.exchange.stl import load_stl  # loads slowly, and few problems have meshes

    loaded: dict[str, Any] = load_stl(content)
    return loaded


def _load_obj(content: io.BytesIO) -> dict[str, Any]:
    from trimesh.exchange.obj import load_obj

    loaded: dict[str, Any] = load_obj(content, resolver=None, skip_materials=True)
    return loaded


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
