"""Obstacles with a body, and motions, as arrays for kernels."""

from __future__ import annotations

from collections.abc import Iterator
from itertools import count
from typing import TypeGuard

import numpy as np

from omniservo.geometry.arrays import FloatArray
from omniservo.planning.constraints.body_gap import BODY_SIZE
from omniservo.planning.constraints.hull_gap import Hull
from omniservo.planning.obstacles.mesh import Mesh
from omniservo.planning.obstacles.obstacle import Body, Obstacle
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
        if is_body(o):
            core = o.core
            reach = core.radius + clearance_of(problem, o)
            place = next(meshes) if isinstance(o, Mesh) else np.zeros(6)
            size = *core.half_extents, core.radius, reach
            rows.append([*core.center, *core.axes.ravel(), *size, motion, *place, core.shape])
    return np.array(rows, dtype=np.float64).reshape(-1, BODY_SIZE)


def is_body(obstacle: Obstacle) -> TypeGuard[Body]:
    """Tell whether an obstacle is judged as a body: a sphere is, if it moves."""
    if isinstance(obstacle, Sphere):
        return obstacle.motion is not None
    return isinstance(obstacle, Body)


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
