"""Task and scene as a recorded job began with them."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np

from omniservo.errors import InputError
from omniservo.geometry.arrays import FloatArray
from omniservo.robots import Arm
from omniservo.runs.loop_delay import LoopDelay
from omniservo.runs.on_robot import on_robot
from omniservo.runs.run_inputs import RunInputs
from omniservo.scenes import Scene, scene_of_task
from omniservo.tasks import Task, TaughtGoal


def begun_as_recorded(
    inputs: RunInputs, goal: TaughtGoal, folder: Path, *, allow_outside: bool
) -> tuple[Task, Scene]:
    """Return task and scene as they were begun with; their files go into a folder that is empty.

    Of a job on a real robot the task is put where the arm stood, with the recorded robot file.

    Raises:
        InputError: a file of the task or the robot is not legal.
    """
    here, there, robot = folder / "files", folder / "robot", inputs.robot
    for place in (here, there):
        place.mkdir()
    inputs.task.write(here)
    task = inputs.task.load(here, goal.camera, allow_outside=allow_outside)
    if robot is None:
        scene = scene_of_task(task)
        start = scene.start_joints if inputs.start_joints is None else inputs.start_joints
        _refuse_other_joints(scene.arm, start)
        return task, replace(scene, start_joints=start)
    robot.files.write(there)
    file = robot.load(there, allow_outside=allow_outside)
    arm = file.loaded_arm()
    start = np.zeros(0) if inputs.start_joints is None else inputs.start_joints
    _refuse_other_joints(arm, start)
    return on_robot(task, file, arm, start, LoopDelay.from_fields(robot.late, "run.json: robot: late"))


def _refuse_other_joints(arm: Arm, start: FloatArray) -> None:
    if start.shape != (arm.dof,):
        raise InputError(f"start_joints: {len(start)} numbers given; {arm.name} has {arm.dof} joints")
