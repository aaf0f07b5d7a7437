"""Teaching: the arm is brought to the goal and takes a picture."""

from __future__ import annotations

from omniservo.geometry.arrays import owned
from omniservo.perception.feature_kind import require_features
from omniservo.runs.feature_kind_of import feature_kind_of
from omniservo.runs.in_view import require_in_view, require_unhidden
from omniservo.simulation import SimulatedRobot
from omniservo.simulation.scene_of_task import goal_joints, scene_of_task
from omniservo.simulation.take_picture import take_picture
from omniservo.tasks import Task, TaughtGoal


def teach_goal(task: Task, *, seed: int = 0) -> TaughtGoal:
    """Return what the camera sees at the task's goal pose, with the arm's joints.

    Raises:
        InputError: the arm does not reach the goal, the target is hidden there, or too few features
            are seen.
    """
    require_in_view(task, task.teach.initial_T_goal.transform, "the goal image")
    scene = scene_of_task(task)
    joints = goal_joints(task, scene)
    robot = SimulatedRobot(scene, seed=seed)
    require_unhidden(task, robot.world, joints, "the goal image")
    robot.place(joints)
    image = take_picture(robot)
    kind = feature_kind_of(task)
    pixels = kind.find(task.camera, image.pixels)
    require_features(len(pixels), kind.name, f"{task.name}: the goal image", kind.least)
    return TaughtGoal(task.camera, image.pixels, owned(pixels), owned(robot.read().joint_positions))
