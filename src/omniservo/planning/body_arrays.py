"""Obstacles with a body, and motions, as arrays for kernels."""

from __future__ import annotations

from collections.abc import Iterator
from itertools import count

import numpy as np

from omniservo.geometry.arrays import FloatArray
from omniservo.planning.constraints.body_gap import BODY_SIZE
from omniservo.planning.constraints.hull_gap import Hull
from omniservo.planning.obstacles.box import Box
from omniservo.planning.obstacles.capsule import Capsule
from omniservo.planning.obstacles.mesh import Mesh
from omniservo.planning.obstacles.obstacle import Obstacle
from omniservo.planning.obstacles.sphere import Sphere
from omniservo.planning.planning_problem import PlanningProblem


def clearance_of(problem: PlanningProblem, obstacle: Obstacle) -> float:
    """Return what the camera centre keeps from an obstacle's surface [m]."""
    return problem.clearance if obstacle.clearance is None else obstacle.clearance


def motions_of(problem: PlanningProblem) -> FloatArray:
    """Return the motions of the obstacles that move, in their order, all with as many coefficients."""
    moving = [o.motion for o in problem.obstacles if o.motion is not None]
    longest = max((m.shape[1] for m in moving), default=1)
    table = np.zeros((len(moving), 3, longest))
    for row, motion in zip(table, moving, strict=True):
        row[:, longest - motion.shape[1] :] = motion
    return table


def motion_indices(problem: PlanningProblem) -> list[float]:
    """Return every obstacle's row among the motions, −1 where it stands still."""
    moving = count()
    return [-1.0 if o.motion is None else float(next(moving)) for o in problem.obstacles]


def bodies_of(problem: PlanningProblem) -> FloatArray:
    """Return the rows of all bodies, see `body_gap` and `solid_gap`, in the obstacles' order."""
    rows, meshes = [], _mesh_places(problem)
    for o, motion in zip(problem.obstacles, motion_indices(problem), strict=True):
        if isinstance(o, Sphere) and o.motion is not None:
            center, axes, extents, radius = o.center, np.eye(3), np.zeros(3), o.radius
        elif isinstance(o, Box):
            center, axes, extents, radius = o.center, box_axes(o.quaternion), o.half_extents, 0.0
        elif isinstance(o, Capsule):
            center, axes, extents, radius = *_rod(o), o.radius
        elif isinstance(o, Mesh):
            center, axes, extents, radius = np.zeros(3), np.eye(3), np.abs(o.vertices).max(axis=0), 0.0
        else:
            continue
        reach, place = radius + clearance_of(problem, o), next(meshes) if isinstance(o, Mesh) else np.zeros(6)
        rows.append([*center, *axes.ravel(), *extents, radius, reach, motion, *place])
    return np.array(rows, dtype=np.float64).reshape(-1, BODY_SIZE)


def hulls_of(problem: PlanningProblem) -> Hull:
    """Return vertices, faces and edges of all meshes, joined in their order."""
    hulls = [o.hull for o in problem.obstacles if isinstance(o, Mesh)]
    return Hull(
        np.concatenate([np.zeros((0, 3)), *(h.corners for h in hulls)]),
        np.concatenate([np.zeros((0, 4)), *(h.faces for h in hulls)]),
        np.concatenate([np.zeros((0, 12)), *(h.edges for h in hulls)]),
    )


def _mesh_places(problem: PlanningProblem) -> Iterator[FloatArray]:
    """Yield where the vertices, faces and edges of every mesh begin and end in `hulls_of` (6,)."""
    begin = np.zeros(3)
    for o in problem.obstacles:
        if isinstance(o, Mesh):
            end = begin + [len(part) for part in o.hull]
            yield np.column_stack([begin, end]).ravel()
            begin = end


def box_axes(quaternion: FloatArray) -> FloatArray:
    """Return the axes of a box, row by row (3, 3): columns of Λ(q)/‖q‖² (20), within 10 roundings each."""
    x, y, z, w = quaternion
    rows = [
        [x * x - y * y - z * z + w * w, 2 * (x * y + z * w), 2 * (x * z - y * w)],
        [2 * (x * y - z * w), -x * x + y * y - z * z + w * w, 2 * (y * z + x * w)],
        [2 * (x * z + y * w), 2 * (y * z - x * w), -x * x - y * y + z * z + w * w],
    ]
    axes: FloatArray = np.array(rows) / (x * x + y * y + z * z + w * w)
    return axes


def _rod(capsule: Capsule) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return centre, axes and half extents of a capsule's segment as a box of no thickness."""
    center = capsule.start + 0.5 * (capsule.end - capsule.start)
    half = 0.5 * (capsule.end - capsule.start)
    length = float(np.linalg.norm(half))
    first = half / length if length > 0.0 else np.array([1.0, 0.0, 0.0])
    across = np.cross(first, np.eye(3)[int(np.argmin(np.abs(first)))])
    second = across / np.linalg.norm(across)
    return center, np.array([first, second, np.cross(first, second)]), np.array([length, 0.0, 0.0])
