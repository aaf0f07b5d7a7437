"""The joints that carry the camera along the plan from where the arm stands."""

from __future__ import annotations

import numpy as np

from omniservo.errors import NoSolutionError
from omniservo.geometry.arrays import FloatArray
from omniservo.planning import CameraPath
from omniservo.robots import FollowedPath, JointPath, follow_path
from omniservo.scenes.scene import Scene
from omniservo.tasks import Task


def own_branch(task: Task, scene: Scene, path: CameraPath, aim: FloatArray | None = None) -> JointPath:
    """Return the branch that goes on from the scene's start joints, with their full turns, led to an aim.

    Raises:
        NoSolutionError: the arm cannot follow on it; the message says which joint, at which w, by how much,
            and whether the arm could from another configuration.
    """
    frames = task.base_T_initial, scene.flange_T_camera
    branch = follow_path(scene.arm, path, *frames, start=scene.start_joints, aim=aim).best
    if branch.feasible:
        return branch
    others = every_branch(task, scene, path)
    raise NoSolutionError(f"the arm cannot follow the planned path: {branch.failures[0]}; {_advice(others)}")


def every_branch(task: Task, scene: Scene, path: CameraPath) -> FollowedPath:
    """Return what each branch in which the arm can begin makes of the path, each with its best full turns."""
    return follow_path(scene.arm, path, task.base_T_initial, scene.flange_T_camera)


def _advice(followed: FollowedPath) -> str:
    """Say whether another configuration at the start would do."""
    if followed.best.feasible:
        start = ", ".join(f"{angle:.1f}" for angle in np.rad2deg(followed.best.positions[0]))
        return f"it can from start.joints_near = [{start}] deg"
    count = len(followed.branches)
    if followed.all_tried:
        return f"nor can it on any of its {count} branches"
    return f"nor can it on any of the {count} branches that a search found, which may miss some"
