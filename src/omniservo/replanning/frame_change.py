"""A problem seen from a pose on the way: everything in the present camera frame, motions from now on."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
from scipy.spatial.transform import RigidTransform, Rotation

from omniservo.geometry.arrays import FloatArray
from omniservo.geometry.quick_poses import composed, moved
from omniservo.planning.degrees import HIGHEST_DEGREE, Degrees
from omniservo.planning.obstacles.half_space import HalfSpace
from omniservo.planning.obstacles.obstacle import Obstacle
from omniservo.planning.planning_problem import PlanningProblem
from omniservo.planning.workspace import Workspace

FREE_DEGREE = 3
"""A path that leaves with a given velocity has freedom from this degree on."""


_POINTS = ("center", "start", "end", "vertices", "points")
"""Attributes of obstacles that are points, (3,) or (k, 3) [m]."""


def problem_from(
    problem: PlanningProblem, pose: RigidTransform, w: float, velocity: FloatArray | None
) -> PlanningProblem:
    """Return the rest of a problem, from ``pose`` at w on, in the camera frame there.

    The new parameter s runs over the rest, w + (1 − w)s. Degrees grow by one where a velocity is given that
    was none before: so much freedom it takes.

    Args:
        problem: the problem, in its initial camera frame.
        pose: initial_T_camera at w.
        w: 0 ≤ w < 1.
        velocity: twist (6,) per unit of w in the camera frame; None: any.
    """
    here = pose.inv()
    lowest = 1 if velocity is None else FREE_DEGREE
    more = int(velocity is not None and problem.initial_velocity is None)
    sigma, tau = (
        min(max(degree + more, lowest), HIGHEST_DEGREE)
        for degree in (problem.degrees.rotation, problem.degrees.translation)
    )
    return replace(
        problem,
        points=moved(here, problem.points),
        initial_T_goal=composed(here, problem.initial_T_goal),
        obstacles=tuple(seen_from(o, here, w) for o in problem.obstacles),
        workspace=None if problem.workspace is None else seen_workspace(problem.workspace, here),
        degrees=Degrees(sigma, tau),
        initial_velocity=None if velocity is None else (1.0 - w) * velocity,
    )


def seen_from(obstacle: Obstacle, here: RigidTransform, w: float) -> Obstacle:
    """Return an obstacle, of any type, in another frame and from w on: x there is ``here`` times x."""
    changes: dict[str, Any] = {
        name: moved(here, getattr(obstacle, name)) for name in _POINTS if hasattr(obstacle, name)
    }
    if isinstance(obstacle, HalfSpace):
        changes = _turned_side(obstacle, here)
    elif (turned := getattr(obstacle, "quaternion", None)) is not None:
        changes["quaternion"] = (here.rotation * Rotation.from_quat(turned)).as_quat()
    if obstacle.motion is not None:
        changes["motion"] = shifted_motion(obstacle.motion, here.rotation, w)
    return replace(obstacle, **changes)


def _turned_side(side: HalfSpace, here: RigidTransform) -> dict[str, Any]:
    """n·x ≥ b and y = R x + p: (R n)·y ≥ b + (R n)·p."""
    normal = here.rotation.apply(np.array(side.normal))
    normal /= np.linalg.norm(normal)
    return {"normal": normal, "offset": side.offset + float(normal @ here.translation)}


def seen_workspace(workspace: Workspace, here: RigidTransform) -> Workspace:
    """Return it in another frame; a box that no longer lies along the axes becomes six half-spaces."""
    if not here.rotation.magnitude() and not here.translation.any():
        return workspace
    sides = list(workspace.half_spaces)
    if workspace.min is not None and workspace.max is not None:
        for axis, normal in enumerate(np.eye(3)):
            sides.append(HalfSpace(normal, float(workspace.min[axis])))
            sides.append(HalfSpace(-normal, -float(workspace.max[axis])))
    return Workspace(half_spaces=tuple(replace(side, **_turned_side(side, here)) for side in sides))


def shifted_motion(motion: FloatArray, turn: Rotation, w: float) -> FloatArray:
    """Return R m(w + (1 − w)s) (3, k+1) by powers of s, highest first, of a motion m by powers of w."""
    line = np.poly1d([1.0 - w, w])
    rows = [np.atleast_1d(np.poly1d(row)(line).coeffs) for row in motion]
    width = motion.shape[1]
    aligned = np.array([np.concatenate([np.zeros(width - len(row)), row]) for row in rows])
    shifted: FloatArray = turn.as_matrix() @ aligned
    return shifted
