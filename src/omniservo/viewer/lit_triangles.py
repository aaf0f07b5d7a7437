"""Triangles whose light is in their colours.

A browser without a GPU computes the light of every pixel of every frame on the processor: lights, shadows
and reflections take it ten times as long as colours that are there already.
"""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

import numpy as np
import trimesh
from scipy.spatial.transform import Rotation

from omniservo.geometry.arrays import FloatArray

_LIGHTS = ((np.array([-0.35, -0.75, 0.55]), 0.42), (np.array([0.8, 0.25, 0.35]), 0.16))
"""directions towards what lights, in the world, and how strongly"""

_AMBIENT = 0.42
_FROM_ABOVE = 0.12
"""more of the ambient light comes from above"""

_EDGE = np.radians(35.0)
"""Sides that meet at a larger angle have an edge between them."""


def lit_triangles(
    parts: Iterable[tuple[Any, tuple[int, int, int]]], world_R_shape: Rotation, opacity: float = 1.0
) -> bytes:
    """Return shapes as one binary glTF file that is drawn as it is, without a light.

    Args:
        parts: `trimesh.Trimesh` in one frame, and the colour of each (sRGB).
        world_R_shape: how that frame stands in the world when the light falls on it.
        opacity: 1 is opaque. Sides that turn away are not drawn: bodies are closed.
    """
    lit = []
    for shape, colour in parts:
        split = trimesh.graph.smooth_shade(shape, angle=_EDGE)
        share = _share_of_light(world_R_shape.apply(np.array(split.vertex_normals)))
        linear = (np.array(colour) / 255.0) ** 2.2
        shades = np.clip(share[:, None] * linear, 0.0, 1.0)
        alpha = np.full((len(shades), 1), opacity)
        colours = np.rint(255.0 * np.hstack([shades, alpha])).astype(np.uint8)
        lit.append(trimesh.Trimesh(split.vertices, split.faces, vertex_colors=colours, process=False))
    scene: Any = trimesh.Scene(trimesh.util.concatenate(lit))

    def unlit(tree: dict[str, Any]) -> None:
        surface = {} if opacity == 1.0 else {"alphaMode": "BLEND"}
        material = {"extensions": {"KHR_materials_unlit": {}}, **surface}
        tree["extensionsUsed"], tree["materials"] = ["KHR_materials_unlit"], [material]
        for mesh in tree["meshes"]:
            for primitive in mesh["primitives"]:
                primitive["material"] = 0

    file: bytes = scene.export(file_type="glb", include_normals=False, tree_postprocessor=unlit)
    return file


def _share_of_light(normals: FloatArray) -> FloatArray:
    """Return how much of its colour a place with a normal (n, 3) in the world shows (n,)."""
    share: FloatArray = _AMBIENT + _FROM_ABOVE * normals[:, 2]
    for direction, strength in _LIGHTS:
        share += strength * np.clip(normals @ (direction / np.linalg.norm(direction)), 0.0, None)
    return share
