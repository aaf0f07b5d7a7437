"""Teaching: the arm is brought to the goal and takes an image."""

from __future__ import annotations

from omniservo.geometry.arrays import owned
from omniservo.perception.feature_kind import require_features
from omniservo.robots import next_image
from omniservo.runs.feature_kind_of import feature_kind_of
from omniservo.runs.in_view import require_in_view, require_unhidden
from omniservo.runs.robot_cell import RobotCell
from omniservo.scenes.scene_of_task import goal_joints
from omniservo.tasks import Task, TaughtGoal


def teach_goal(task: Task, cell: RobotCell) -> TaughtGoal:
    """Return what the camera sees at the task's goal pose, with the arm's joints.

    Raises:
        InputError: the arm does not reach the goal, the target is hidden there, or too few features
            are seen.
    """
    require_in_view(task, task.teach.initial_T_goal.transform, "the goal image")
    joints = goal_joints(task, cell.scene)
    require_unhidden(task, cell, joints, "the goal image")
    cell.bring_arm_to(joints)
    return teach_here(task, cell)


def teach_here(task: Task, cell: RobotCell) -> TaughtGoal:
    """Return what the camera sees from where the arm now stands, with its joints.

    Raises:
        InputError: too few features are seen.
    """
    image = next_image(cell.camera, cell.wait)
    kind = feature_kind_of(task)
    pixels = kind.find(task.camera, image.pixels)
    require_features(len(pixels), kind.name, f"{task.name}: the goal image", kind.least)
    return TaughtGoal(task.camera, image.pixels, owned(pixels), owned(cell.driver.read().joint_positions))
