"""A task as it would be stated if it began where the arm now stands."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from scipy.spatial.transform import RigidTransform

from omniservo.geometry.arrays import FloatArray
from omniservo.scenes.scene import Scene
from omniservo.tasks import Task
from omniservo.tasks.task import Pose


def begun_elsewhere(task: Task, scene: Scene, joints: FloatArray, room: float) -> tuple[Task, Scene]:
    """Return task and scene with the start at joints (n,) [rad]; all places are seen from the camera there.

    Args:
        task: with its start.
        scene: likewise.
        joints: where the arm stands.
        room: what obstacles may be off where the joints have them [m]: it joins the tracking margin, and
            what obstacles have for a clearance of their own.
    """
    begun = begun_at(task, scene.world_T_camera(joints), joints, room)
    return begun, replace(scene, start_joints=np.asarray(joints))


def begun_at(task: Task, world_T_here: RigidTransform, joints: FloatArray, room: float) -> Task:
    """Return the task alone, where these joints (n,) bring the camera to ``world_T_here``."""
    here_T_before = world_T_here.inv() * task.start.world_T_camera.transform
    start, planning = task.start, task.planning
    known = tuple(
        section.transformed(here_T_before).model_copy(
            update={} if section.clearance is None else {"clearance": section.clearance + room}
        )
        for section in planning.obstacles
    )
    workspace = planning.workspace
    turned = here_T_before.rotation
    goal = here_T_before * task.teach.initial_T_goal.transform
    return task.model_copy(
        update={
            "start": start.model_copy(
                update={"world_T_camera": _pose(world_T_here), "joints_near": tuple(joints.tolist())}
            ),
            "target": task.target.transformed(here_T_before),
            "obstacles": tuple(block.transformed(here_T_before) for block in task.obstacles),
            "surroundings": tuple(block.transformed(here_T_before) for block in task.surroundings),
            "teach": task.teach.model_copy(update={"initial_T_goal": _pose(goal)}),
            "moves": tuple(
                move.model_copy(update={"by": tuple(turned.apply(move.by).tolist())}) for move in task.moves
            ),
            "planning": planning.model_copy(
                update={
                    "obstacles": known,
                    "tracking_margin": planning.tracking_margin + room,
                    "workspace": None if workspace is None else workspace.transformed(here_T_before),
                }
            ),
        }
    )


def _pose(pose: RigidTransform) -> Pose:
    return Pose(
        translation=tuple(pose.translation.tolist()),
        rotation_vector=tuple(pose.rotation.as_rotvec().tolist()),
    )
