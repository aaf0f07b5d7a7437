"""The page's situation as a task: what is saved, and what "servo" carries out."""

from __future__ import annotations

from typing import Any

from scipy.spatial.transform import RigidTransform

from omniservo.errors import InputError
from omniservo.planning import Box
from omniservo.planning.obstacles.obstacle_fields import obstacle_fields
from omniservo.scenes import SceneBox
from omniservo.tasks import Task
from omniservo.tasks.placed import FramedBlock
from omniservo.tasks.task import Pose, StartSection
from omniservo.viewer.situation import ArmInScene, Situation


def edited_task(situation: Situation) -> Task:
    """Return the task with start, goal, obstacles, margins and camera as the page has them.

    Bodies stand where they stand in the world. Of the planner's obstacles those are bodies that were, and
    boxes that were added: a task knows no bodies of another shape.

    Raises:
        InputError: the situation has no task; or its obstacles move or its clearance cannot be stated.
    """
    arm = situation.arm
    if arm is None:
        raise InputError("there is no task: the page shows a planning problem without an arm")
    task, problem = arm.task, situation.problem
    before_T_now = task.start.world_T_camera.transform.inv() * situation.world_T_initial
    now_T_before = before_T_now.inv()
    changes: dict[str, Any] = {
        "camera": arm.scene.camera,
        "start": StartSection(
            world_T_camera=pose_of(situation.world_T_initial),
            joints_near=tuple(arm.scene.start_joints.tolist()),
        ),
        "teach": task.teach.model_copy(update={"initial_T_goal": pose_of(problem.initial_T_goal)}),
        "target": task.target.transformed(now_T_before),
        "obstacles": (*_others(arm, situation), *_bodies(situation)),
        "surroundings": tuple(block.transformed(now_T_before) for block in task.surroundings),
        "planning": _planning(situation, task, now_T_before),
        "moves": (),
    }
    fields = {name: getattr(task, name) for name in Task.model_fields}
    return Task.model_validate({**fields, **changes})


def pose_of(a_T_b: RigidTransform) -> Pose:
    """Return a pose as a task states it."""
    return Pose(
        translation=tuple(a_T_b.translation.tolist()), quaternion=tuple(a_T_b.rotation.as_quat().tolist())
    )


def _planning(situation: Situation, task: Task, now_T_before: RigidTransform) -> dict[str, Any]:
    problem, planning = situation.problem, task.planning
    workspace = planning.workspace
    fields = {name: getattr(planning, name) for name in type(planning).model_fields}
    return {
        **fields,
        "obstacles": [obstacle_fields(o) for o in problem.obstacles],
        "clearance": max(problem.clearance - planning.tracking_margin, 0.0),
        "visibility_margin": problem.visibility_margin,
        "occlusion": problem.occlusion,
        "risk": situation.risk or planning.risk,
        "degrees": {"rotation": problem.degrees.rotation, "translation": problem.degrees.translation},
        "workspace": None if workspace is None else workspace.transformed(now_T_before),
    }


def _bodies(situation: Situation) -> list[FramedBlock]:
    boxes = [situation.problem.obstacles[i] for i in sorted(situation.bodies)]
    return [
        FramedBlock(
            center=tuple(o.center.tolist()), quaternion=tuple(o.quaternion.tolist()),
            half_extents=tuple(o.half_extents.tolist()),
        )
        for o in boxes
        if isinstance(o, Box)
    ]  # fmt: skip


def _others(arm: ArmInScene, situation: Situation) -> list[FramedBlock]:
    """Return the bodies that no obstacle of the planner stands for."""
    initial_T_world = situation.world_T_initial.inv()
    boxes = [body for body in arm.scene.obstacles if isinstance(body, SceneBox)]
    poses = [initial_T_world * body.world_T_box for body in boxes]
    return [
        FramedBlock(
            center=tuple(pose.translation.tolist()), quaternion=tuple(pose.rotation.as_quat().tolist()),
            half_extents=tuple(body.half_extents.tolist()),
        )
        for body, pose in zip(boxes, poses, strict=True)
    ]  # fmt: skip
