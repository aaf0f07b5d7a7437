"""Teaching: the arm is brought to the goal and takes a picture."""

from __future__ import annotations

from omniservo.errors import InputError
from omniservo.geometry.arrays import FloatArray, frozen
from omniservo.perception import find_dots
from omniservo.runs.in_view import LEAST_DOTS, require_in_view
from omniservo.simulation import SimulatedRobot
from omniservo.simulation.scene_of_task import goal_joints, scene_of_task
from omniservo.simulation.take_picture import take_picture
from omniservo.tasks import Task, TaughtGoal


def teach_goal(task: Task, *, seed: int = 0) -> TaughtGoal:
    """Return what the camera sees at the task's goal pose, with the arm's joints.

    Raises:
        InputError: the arm does not reach the goal, or fewer than eight dots are seen there.
    """
    require_in_view(task, task.teach.initial_T_goal.transform, "the goal image")
    scene = scene_of_task(task)
    joints = goal_joints(task, scene)
    robot = SimulatedRobot(scene, seed=seed)
    robot.place(joints)
    image = take_picture(robot)
    dots = find_dots(image.pixels, task.camera)
    require_dots(dots.pixels, f"{task.name}: the goal image")
    return TaughtGoal(task.camera, image.pixels, frozen(dots.pixels), frozen(robot.read().joint_positions))


def require_dots(pixels: FloatArray, where: str) -> None:
    """Refuse a picture with too few dots.

    Raises:
        InputError: fewer than eight.
    """
    if len(pixels) < LEAST_DOTS:
        raise InputError(f"{where}: {len(pixels)} dots found; at least {LEAST_DOTS} are needed")
