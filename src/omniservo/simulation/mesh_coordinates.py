"""Where in its texture a point of a mesh lies."""

from __future__ import annotations

from typing import Any

import numpy as np
from scipy.spatial import cKDTree

from omniservo.geometry.arrays import FloatArray, IntArray

_NEAR = 12
"""faces whose middles are nearest are tried first"""

_INSIDE = -1e-6
_AT_ONCE = 2_000_000
"""pairs of points and faces"""


def mesh_coordinates(model: Any, mesh: int, points: FloatArray) -> FloatArray | None:
    """Return texture coordinates (n, 2) of points (n, 3) on a mesh's faces, in its frame; None: it has none.

    The face of each point is the one that holds it: of those whose middles are nearest, else of all.
    """
    first = int(model.mesh_texcoordadr[mesh])
    if first < 0:
        return None
    begin, count = int(model.mesh_faceadr[mesh]), int(model.mesh_facenum[mesh])
    vertices = model.mesh_vert[int(model.mesh_vertadr[mesh]) :].astype(np.float64)
    corners = vertices[model.mesh_face[begin : begin + count]]
    stated = model.mesh_texcoord[first + model.mesh_facetexcoord[begin : begin + count]].astype(np.float64)
    near = cKDTree(corners.mean(axis=1)).query(points, k=min(_NEAR, count))[1].reshape(len(points), -1)
    faces, shares, misfit = _best(corners, near, points)
    lost = np.flatnonzero(misfit > -_INSIDE)
    for part in np.array_split(lost, 1 + len(lost) * count // _AT_ONCE):
        if len(part):
            everywhere = np.broadcast_to(np.arange(count), (len(part), count))
            faces[part], shares[part], _ = _best(corners, everywhere, points[part])
    mixed: FloatArray = np.einsum("nk,nkj->nj", shares, stated[faces])
    return mixed


def _best(
    corners: FloatArray, tried: IntArray, points: FloatArray
) -> tuple[IntArray, FloatArray, FloatArray]:
    """Return for each point (n,) the face of those tried (n, k) that holds it, its corners' shares (n, 3).

    Third: by how much it does not (n,), over the face's size; 0: it does.
    """
    a, b, c = np.moveaxis(corners[tried], 2, 0)
    u, v, w = b - a, c - a, points[:, None, :] - a
    normal = np.cross(u, v)
    size = np.maximum(np.einsum("nkj,nkj->nk", normal, normal), 1e-300)
    third = np.einsum("nkj,nkj->nk", np.cross(u, w), normal) / size
    second = np.einsum("nkj,nkj->nk", np.cross(w, v), normal) / size
    shares = np.stack([1.0 - second - third, second, third], axis=-1)
    outside = np.maximum(-shares.min(axis=-1), 0.0)
    away = np.abs(np.einsum("nkj,nkj->nk", w, normal)) / size**0.75  # over the square root of the area
    misfit = np.maximum(outside, away)
    chosen, rows = misfit.argmin(axis=1), np.arange(len(points))
    return tried[rows, chosen], shares[rows, chosen].clip(0.0, 1.0), misfit[rows, chosen]
