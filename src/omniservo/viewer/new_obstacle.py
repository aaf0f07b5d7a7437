"""A new obstacle of every kind, near the middle of the path; obstacles from files."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from omniservo.errors import InputError
from omniservo.files import read_document
from omniservo.planning import Box, Capsule, Cloud, Cylinder, Ellipsoid, HalfSpace, Mesh, Sphere
from omniservo.planning.obstacles.cloud_file import read_cloud
from omniservo.planning.obstacles.mesh_file import read_mesh
from omniservo.planning.obstacles.obstacle import Obstacle
from omniservo.planning.obstacles.obstacle_fields import obstacles_from_fields
from omniservo.planning.problem_file import FORMAT
from omniservo.viewer.situation import Situation

_BESIDE = 0.35
"""How far from the middle of the straight way it stands, in parts of the target's distance."""

_BEHIND = 1.5
"""So many times the target's distance ahead is a wall."""

_WEDGE = np.array(
    [[-1, -1, -1], [1, -1, -1], [1, 1, -1], [-1, 1, -1], [-1, 0, 1], [1, 0, 1]], dtype=np.float64
)

_SHEET = np.stack(np.meshgrid(np.linspace(-1, 1, 9), np.linspace(-1, 1, 9), [0.0]), axis=-1).reshape(-1, 3)


def new_obstacle(kind: str, situation: Situation) -> Obstacle:
    """Return one of a kind of `KINDS`, in the initial camera frame, beside the straight way to the goal."""
    problem = situation.problem
    far = float(np.linalg.norm(problem.points, axis=1).mean())
    size = 0.06 * far
    there = 0.5 * problem.initial_T_goal.translation + np.array([_BESIDE * far, 0.0, 0.0])
    up = np.array([0.0, 2.0 * size, 0.0])
    match kind:
        case "sphere":
            return Sphere(there, size)
        case "box":
            return Box(there, np.array([size, 2.0 * size, size]))
        case "capsule":
            return Capsule(there - up, there + up, 0.6 * size)
        case "cylinder":
            return Cylinder(there - up, there + up, 0.6 * size)
        case "ellipsoid":
            return Ellipsoid(there, np.array([size, 2.0 * size, 0.7 * size]))
        case "half_space":
            return HalfSpace(np.array([0.0, 0.0, -1.0]), -_BEHIND * far)
        case "mesh":
            return Mesh(there + size * _WEDGE)
        case "cloud":
            return Cloud(there + 2.0 * size * _SHEET, 0.25 * size)
    raise InputError(f"obstacle: {kind!r} given; no such kind")


def obstacles_of_file(path: Path) -> Sequence[Obstacle]:
    """Return what a file holds: a mesh's convex parts, a cloud's points, or a problem file's obstacles [m].

    Raises:
        InputError: of another kind, or not legal.
    """
    suffix = path.suffix.lower()
    if suffix in (".stl", ".obj", ".dae"):
        return tuple(Mesh(part, file=path.name) for part in read_mesh(path))
    if suffix in (".npy", ".xyz", ".txt", ".ply"):
        return (Cloud(read_cloud(path), 0.0, file=path.name),)
    fields = read_document(path)
    listed = fields.get("obstacles") if isinstance(fields, dict) else None
    if not isinstance(listed, list) or fields.get("format", FORMAT) != FORMAT:
        raise InputError(f"{path}: no list of obstacles")
    return tuple(o for item in listed for o in obstacles_from_fields(item))
