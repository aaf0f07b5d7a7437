"""COLLADA (DAE) documents: the triangles of their scene, as robots' descriptions use them."""

from __future__ import annotations

from collections.abc import Iterator
from xml.etree.ElementTree import Element

import numpy as np
from scipy.spatial.transform import Rotation

from omniservo.files.xml_files import parse_elements
from omniservo.geometry.arrays import FloatArray, IntArray

_MOVES = ("matrix", "translate", "rotate", "scale")

_OF_ACCESSORS = (("stride", "1"), ("offset", "0"))
"""of the numbers (v, 3) of a source: how many apart, and from which on; as they are by default"""

_MOST_TRIANGLES = 2_000_000
"""of a scene, counting what it shows several times"""

_MOST_NODES = 100_000
"""likewise: nodes that show others, twice each, many times over"""


def collada_triangles(text: str) -> tuple[FloatArray, IntArray]:
    """Return vertices (v, 3) [m] and triangles (f, 3) of a document's scene; without a scene, of all it has.

    Lengths are in the document's unit. As in RViz and MoveIt its upward axis is not checked: coordinates
    are those of the link. Polygons are cut as fans. Colours, lines and animations are not read.

    Raises:
        ValueError: no such document, or a part that is not read: strips, skeletons.
        KeyError, IndexError: something in it is missing.
    """
    root = parse_elements(text, "document")
    if root.tag != "COLLADA":
        raise ValueError(f"root element {root.tag[:20]!r}; legal: 'COLLADA'")
    unit = root.find("asset/unit")
    metres = 1.0 if unit is None else float(unit.get("meter", "1"))
    pieces = {e.get("id", ""): _triangles(e) for e in root.iterfind("library_geometries/geometry")}
    vertices, triangles, count, total = [np.zeros((0, 3))], [np.zeros((0, 3), np.int64)], 0, 0
    for name, pose in _shown(root, list(pieces)):
        points, faces = pieces[name]
        total += len(faces)
        if total > _MOST_TRIANGLES:
            raise ValueError(f"more than {_MOST_TRIANGLES} triangles")
        vertices.append(metres * (points @ pose[:3, :3].T + pose[:3, 3]))
        triangles.append(faces + count)
        count += len(points)
    return np.concatenate(vertices), np.concatenate(triangles)


def _shown(root: Element, names: list[str]) -> Iterator[tuple[str, FloatArray]]:
    """Yield the geometries of the scene with their poses (4, 4)."""
    scene = root.find("scene/instance_visual_scene")
    if scene is None:
        yield from ((name, np.eye(4)) for name in names)
        return
    for candidate in root.iterfind("library_visual_scenes/visual_scene"):
        if candidate.get("id") == _target(scene):
            yield from _of_nodes(
                list(candidate.iterfind("node")), {e.get("id"): e for e in root.iter("node")}
            )


def _of_nodes(nodes: list[Element], named: dict[str | None, Element]) -> Iterator[tuple[str, FloatArray]]:
    """Yield the geometries of nodes, of those in them and those shown by name, with their poses (4, 4)."""
    waiting, count = [(node, np.eye(4)) for node in nodes], 0
    while waiting:
        count += 1
        if count + len(waiting) > _MOST_NODES:
            raise ValueError(f"more than {_MOST_NODES} nodes, or one that shows itself")
        node, pose = waiting.pop()
        for child in node:
            if child.tag in _MOVES:
                pose = pose @ _moved(child.tag, np.array((child.text or "").split(), dtype=np.float64))
            elif child.tag in ("instance_controller", "lookat", "skew"):
                raise ValueError(f"<{child.tag}> in a scene is not read")
        yield from ((_target(child), pose) for child in node.iterfind("instance_geometry"))
        waiting += [(child, pose) for child in node.iterfind("node")]
        waiting += [(named[_target(child)], pose) for child in node.iterfind("instance_node")]


def _moved(kind: str, values: FloatArray) -> FloatArray:
    pose = np.eye(4)
    if kind == "matrix":
        return values.reshape(4, 4)
    if kind == "translate":
        pose[:3, 3] = values
    elif kind == "scale":
        pose[:3, :3] = np.diag(values)
    else:
        axis, degrees = values[:3] / np.linalg.norm(values[:3]), float(values[3])
        pose[:3, :3] = Rotation.from_rotvec(np.deg2rad(degrees) * axis).as_matrix()
    return pose


def _triangles(geometry: Element) -> tuple[FloatArray, IntArray]:
    mesh = geometry.find("mesh")
    if mesh is None:
        raise ValueError("a <geometry> without <mesh> is not read")
    places: dict[str, FloatArray] = {}
    for held in mesh.iterfind("vertices"):
        for given in held.iterfind("input"):
            if given.get("semantic") == "POSITION":
                places[held.get("id", "")] = _positions(mesh, _target(given, "source"))
    vertices, triangles, count = [np.zeros((0, 3))], [np.zeros((0, 3), np.int64)], 0
    for faces in mesh:
        if faces.tag in ("polygons", "tristrips", "trifans"):
            raise ValueError(f"<{faces.tag}> is not read; legal: triangles, polylist")
        if faces.tag not in ("triangles", "polylist"):
            continue
        inputs = {given.get("semantic"): given for given in faces.iterfind("input")}
        stride = 1 + max(int(given.get("offset", "0")) for given in faces.iterfind("input"))
        points = places[_target(inputs["VERTEX"], "source")]
        corners = _integers(faces, "p").reshape(-1, stride)[:, int(inputs["VERTEX"].get("offset", "0"))]
        counts = _integers(faces, "vcount") if faces.tag == "polylist" else np.full(len(corners) // 3, 3)
        if (counts > len(corners)).any() or counts.sum() != len(corners):
            raise ValueError(f"{len(corners)} corners, which are not those of the polygons")
        chosen = corners[_fans(counts)].reshape(-1, 3)
        if len(chosen) and (chosen.min() < 0 or chosen.max() >= len(points)):
            raise ValueError(f"a corner {chosen.max()}, but only {len(points)} vertices")
        used, rows = np.unique(chosen, return_inverse=True)  # else each part of a few triangles had them all
        vertices.append(points[used])
        triangles.append(rows.reshape(-1, 3) + count)
        count += len(used)
    return np.concatenate(vertices), np.concatenate(triangles)


def _positions(mesh: Element, name: str) -> FloatArray:
    """Return the numbers (v, 3) of a source."""
    source = next(held for held in mesh.iterfind("source") if held.get("id") == name)
    values, access = source.find("float_array"), source.find("technique_common/accessor")
    if values is None:
        raise ValueError(f"source {name[:30]!r} has no numbers")
    stride, begin = (3, 0) if access is None else (int(access.get(k, d)) for k, d in _OF_ACCESSORS)
    table = np.array((values.text or "").split()[begin:], dtype=np.float64).reshape(-1, stride)
    return table[:, :3]


def _fans(counts: IntArray) -> IntArray:
    """Return which corners make triangles (3 f,): each polygon's first with two that follow each other."""
    if len(counts) and counts.min() < 3:
        raise ValueError("a polygon of fewer than 3 corners")
    firsts = np.cumsum(counts) - counts
    polygon = np.repeat(np.arange(len(counts)), counts - 2)
    inner = np.arange(len(polygon)) - np.repeat(np.cumsum(counts - 2) - (counts - 2), counts - 2)
    corners: IntArray = firsts[polygon][:, None] + np.stack([0 * inner, inner + 1, inner + 2], axis=1)
    return corners.reshape(-1)


def _integers(element: Element, tag: str) -> IntArray:
    held = element.find(tag)
    return np.array(("" if held is None else held.text or "").split(), dtype=np.int64)


def _target(element: Element, attribute: str = "url") -> str:
    return element.get(attribute, "").removeprefix("#")
