"""A world's shapes as triangles: what a page or a file of three dimensions shows of it."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import mujoco
import numpy as np
import trimesh
from scipy.spatial.transform import RigidTransform, Rotation

from omniservo.geometry.arrays import FloatArray, IntArray
from omniservo.simulation.world import ARM_GROUP, CAMERA_GROUP, SURROUNDINGS_GROUP, World

_ROUND = 24
"""Sides of what is round: each triangle costs time in every frame of a browser without a GPU."""

_PLANE = 1.5
"""Half of the side of the square that stands for a plane without end [m]."""

_KINDS = mujoco.mjtGeom


@dataclass(frozen=True, eq=False)
class BodyMesh:
    """The shapes of one colour that one body has, in the body's frame."""

    body: int
    """its number in the world's model; 0: it does not move"""
    name: str
    """of the body; empty for what has none"""
    vertices: FloatArray
    """(n, 3) [m]"""
    faces: IntArray
    """(m, 3) rows of vertices, counter-clockwise from outside"""
    colour: tuple[int, int, int]
    """sRGB"""


def body_meshes(world: World) -> list[BodyMesh]:
    """Return what is seen of a world: arm, camera, boards, dots, bodies, floor."""
    model = world.model
    shapes: dict[tuple[int, tuple[int, int, int]], list[Any]] = {}
    for geom in range(model.ngeom):
        if model.geom_group[geom] in (SURROUNDINGS_GROUP, ARM_GROUP, CAMERA_GROUP):
            body, colour = int(model.geom_bodyid[geom]), _srgb(model.geom_rgba[geom, :3])
            shapes.setdefault((body, colour), []).append(_triangles(model, geom))
    found = []
    for (body, colour), parts in shapes.items():
        whole: Any = trimesh.util.concatenate(parts)
        name = str(model.body(body).name)
        found.append(BodyMesh(body, name, np.array(whole.vertices), np.array(whole.faces), colour))
    return found


class BodyPoses:
    """Where the bodies of a world are for given joints. It owns MjData: one for each thread."""

    def __init__(self, world: World) -> None:
        self._model = world.model
        self._data = mujoco.MjData(world.model)

    def at(self, q: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return places (bodies, 3) [m] and quaternions (bodies, 4), scalar first, for joints (n,) [rad]."""
        self._data.qpos[:] = q
        mujoco.mj_kinematics(self._model, self._data)
        return self._data.xpos.copy(), self._data.xquat.copy()


def solid_triangles(kind: str, size: FloatArray, vertices: FloatArray | None) -> Any:
    """Return a body of a `Solid`'s kind and size as triangles, in its own frame; a half-space as a square."""
    match kind:
        case "sphere":
            return trimesh.creation.icosphere(2, float(size[0]))
        case "ellipsoid":
            return trimesh.creation.icosphere(2, 1.0).apply_scale(size)
        case "capsule":
            return capsule(float(size[0]), 2.0 * float(size[1]))
        case "cylinder":
            shape = trimesh.creation.cylinder(1.0, 2.0 * float(size[1] / size[0]), sections=_ROUND)
            return shape.apply_scale(float(size[0]))  # as of a capsule
        case "box":
            return trimesh.creation.box(2.0 * size)
        case "hull":
            return trimesh.Trimesh(vertices).convex_hull
    return _square()


def _triangles(model: Any, geom: int) -> Any:
    kind, size = model.geom_type[geom], np.array(model.geom_size[geom])
    if kind == _KINDS.mjGEOM_MESH:
        mesh = int(model.geom_dataid[geom])
        first, face = int(model.mesh_vertadr[mesh]), int(model.mesh_faceadr[mesh])
        corners = model.mesh_vert[first : first + int(model.mesh_vertnum[mesh])]
        shape = trimesh.Trimesh(corners, model.mesh_face[face : face + int(model.mesh_facenum[mesh])])
    else:
        name = _KINDS(kind).name.removeprefix("mjGEOM_").lower()
        shape = solid_triangles("half_space" if name == "plane" else name, size, None)
    turn = Rotation.from_quat(np.array(model.geom_quat[geom]), scalar_first=True)
    pose = RigidTransform.from_components(np.array(model.geom_pos[geom]), turn)
    return shape.apply_transform(pose.as_matrix())


def capsule(radius: float, length: float, count: tuple[int, int] = (_ROUND // 2, _ROUND)) -> Any:
    """Return a capsule about its middle along z, ``length`` [m] between the middles of its ends.

    Args:
        radius: [m].
        length: [m].
        count: of its sides, along and round it.
    """
    shape: Any = trimesh.creation.capsule(length / radius, 1.0, count=list(count))
    shape.apply_translation([0.0, 0.0, -shape.bounds.mean(axis=0)[2]])
    return shape.apply_scale(radius)  # of one of a tenth of a millimetre trimesh would leave sides out


def _square() -> Any:
    corners = _PLANE * np.array([[-1, -1, 0], [1, -1, 0], [1, 1, 0], [-1, 1, 0]], dtype=np.float64)
    return trimesh.Trimesh(corners, [[0, 1, 2], [0, 2, 3]])


def _srgb(linear: FloatArray) -> tuple[int, int, int]:
    """Return 8 bit sRGB of a linear colour (3,)."""
    value = np.clip(linear, 0.0, 1.0)
    encoded = np.where(value <= 0.0031308, 12.92 * value, 1.055 * value ** (1 / 2.4) - 0.055)
    red, green, blue = np.rint(255.0 * encoded).astype(int).tolist()
    return red, green, blue
