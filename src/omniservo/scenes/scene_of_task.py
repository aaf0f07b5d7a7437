"""From a task to its scene: the initial camera frame becomes world coordinates."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from scipy.spatial.transform import RigidTransform

from omniservo.errors import InputError
from omniservo.geometry.arrays import FloatArray
from omniservo.robots import load_arm
from omniservo.scenes.panels_of_target import panels_of_target
from omniservo.scenes.scene import (
    BOARD_COLOUR,
    OBSTACLE_COLOUR,
    SURROUNDINGS_COLOUR,
    Colour,
    Dots,
    Scene,
    SceneBox,
)
from omniservo.scenes.sensor import Sensor
from omniservo.tasks import Block, Task


def scene_of_task(task: Task) -> Scene:
    """Return the world that a task describes, the arm at the task's start.

    Raises:
        InputError: the arm cannot bring the camera to its start pose.
    """
    world_T_initial = task.start.world_T_camera.transform
    arm = load_arm(task.arm.model, flange=task.arm.flange, packages=task.arm.packages)
    world_T_base = RigidTransform.from_translation(np.asarray(task.arm.foot))
    flange_T_camera = task.arm.flange_T_camera.transform
    near = np.asarray(task.start.joints_near)
    if len(near) != arm.dof:
        raise InputError(f"start.joints_near: {len(near)} numbers given; {arm.name} has {arm.dof} joints")
    try:
        start = arm.inverse_near(world_T_base.inv() * world_T_initial * flange_T_camera.inv(), near)
    except InputError as error:
        raise InputError(f"start.world_T_camera: {error}") from None
    return Scene(
        arm=arm,
        world_T_base=world_T_base,
        flange_T_camera=flange_T_camera,
        camera=task.camera,
        start_joints=start,
        sensor=Sensor(**task.sensor.model_dump()),
        dots=_dots(task, world_T_initial),
        panels=panels_of_target(task.target, world_T_initial),
        boards=_boxes("board", task.target.boards, world_T_initial, BOARD_COLOUR),
        obstacles=_boxes("obstacle", task.obstacles, world_T_initial, OBSTACLE_COLOUR),
        surroundings=_boxes("surroundings", task.surroundings, world_T_initial, SURROUNDINGS_COLOUR),
        floor=float(world_T_base.translation[2]),
    )


def goal_joints(task: Task, scene: Scene) -> FloatArray:
    """Return the joints (n,) [rad] that bring the camera to the pose where the goal is taught.

    Raises:
        InputError: the arm does not reach it.
    """
    world_T_goal = task.start.world_T_camera.transform * task.teach.initial_T_goal.transform
    try:
        return scene.joints_for(world_T_goal, scene.start_joints)
    except InputError as error:
        raise InputError(f"teach.initial_T_goal: {error}") from None


def _boxes(
    kind: str, blocks: Sequence[Block], world_T_initial: RigidTransform, colour: Colour
) -> tuple[SceneBox, ...]:
    return tuple(
        SceneBox(f"{kind} {i}", world_T_initial * block.transform, np.asarray(block.half_extents), colour)
        for i, block in enumerate(blocks)
    )


def _dots(task: Task, world_T_initial: RigidTransform) -> Dots | None:
    radius = task.target.dot_radius
    if radius is None:
        return None
    centers = np.array([dot.center for dot in task.target.dots])
    normals = np.array([dot.normal for dot in task.target.dots])
    return Dots(world_T_initial.apply(centers), world_T_initial.rotation.apply(normals), radius)
