"""The vertices of meshes as they were stated: MuJoCo keeps its own with seven digits.

They stand in its models beside the meshes, as custom numbers, so that whoever has the model has them.
"""

from __future__ import annotations

from typing import Any

import mujoco
import numpy as np
from scipy.spatial import ConvexHull, QhullError
from scipy.spatial.transform import Rotation

from omniservo.geometry.arrays import FloatArray
from omniservo.robots.collision.plain import PLAIN

_THINNEST = 1e-4
"""[m], and of the longest side: MuJoCo, which takes no mesh without a volume, is shown one so thick"""

_CORNERS = np.array(np.meshgrid(*[(-1.0, 1.0)] * 3)).reshape(3, -1).T


def add_hull(spec: Any, name: str, vertices: FloatArray) -> Any:
    """Add a mesh to MuJoCo's MjSpec whose convex hull is that of vertices (n, 3) [m]; return it."""
    convex = mujoco.mjtMeshInertia.mjMESH_INERTIA_CONVEX
    mesh = spec.add_mesh(PLAIN, name=name, uservert=_thick(vertices).ravel(), inertia=convex)
    keep_vertices(spec, mesh, vertices)
    return mesh


def keep_vertices(spec: Any, mesh: Any, vertices: FloatArray) -> None:
    """State the vertices (n, 3) of a mesh of MuJoCo's MjSpec as they are, before its scale."""
    turned = Rotation.from_quat(np.array(mesh.refquat), scalar_first=True).inv()
    placed = turned.apply(vertices - mesh.refpos) * mesh.scale
    spec.add_numeric(name=_name(mesh.name), data=placed.ravel(), size=placed.size)


def corners_of(model: Any, mesh: int) -> FloatArray:
    """Return the vertices (n, 3) of a mesh as they were stated, in the frame that MuJoCo gives it [m]."""
    numbers = model.numeric(_name(model.mesh(mesh).name)).data
    turned = Rotation.from_quat(model.mesh_quat[mesh], scalar_first=True).inv()
    corners: FloatArray = turned.apply(numbers.reshape(-1, 3) - model.mesh_pos[mesh])
    return corners


def on_hull(vertices: FloatArray) -> FloatArray:
    """Return those of vertices (n, 3) that are not inside the hull of the others; all, where it is flat.

    Each place is there once: a file of triangles without shared corners, as STL, has it many times.
    """
    vertices = vertices[np.sort(np.unique(vertices, axis=0, return_index=True)[1])]
    try:
        hull = ConvexHull(vertices, qhull_options="Qt Qc")
    except QhullError:
        return vertices
    return vertices[np.union1d(hull.vertices, hull.coplanar[:, 0])]


def _name(mesh: str) -> str:
    return f"vertices of {mesh}"


def _thick(vertices: FloatArray) -> FloatArray:
    """Return the vertices (n, 3), or where they are flat or tiny the corners of a box that holds them."""
    middle = vertices.mean(axis=0)
    axes = np.linalg.svd(vertices - middle, full_matrices=False)[2]
    along = (vertices - middle) @ axes.T
    low, high = along.min(axis=0), along.max(axis=0)
    least = _THINNEST * max(1.0, float((high - low).max()))
    if (high - low).min() >= least:
        return vertices
    half = 0.5 * np.maximum(high - low, least)
    box: FloatArray = middle + (0.5 * (low + high) + _CORNERS * half) @ axes
    return box
