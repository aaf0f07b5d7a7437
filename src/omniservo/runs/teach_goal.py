"""Teaching: the arm is brought to the goal and takes an image."""

from __future__ import annotations

import numpy as np

from omniservo.errors import InputError
from omniservo.geometry.arrays import owned
from omniservo.perception.feature_kind import require_features
from omniservo.robots import next_image
from omniservo.runs.feature_kind_of import feature_kind_of
from omniservo.runs.in_view import require_in_view, require_unhidden
from omniservo.runs.robot_cell import RobotCell
from omniservo.scenes.scene_of_task import goal_joints
from omniservo.tasks import Task, TaughtGoal

STANDS = 1e-3
"""An arm whose joints turn by less while an image is taken stands [rad]."""


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
        InputError: too few features are seen, or the arm moves.
    """
    before = cell.driver.read().joint_positions
    image = next_image(cell.camera, cell.wait)
    joints = owned(cell.driver.read().joint_positions)
    turned = np.abs(joints - before)
    if turned.max() > STANDS:
        name, most = cell.scene.arm.joint_names[int(turned.argmax())], np.rad2deg(turned.max())
        touching = [] if cell.truth is None else sorted(" and ".join(pair) for pair in cell.truth.contacts())
        why = f": {', '.join(touching)} touch" if touching else ""
        raise InputError(
            f"{task.name}: the goal image: {name} turned by {most:.2f} deg while it was taken{why}; "
            f"legal: an arm that stands, to {np.rad2deg(STANDS):.2f} deg"
        )
    kind = feature_kind_of(task)
    pixels = kind.find(task.camera, image.pixels)
    require_features(len(pixels), kind.name, f"{task.name}: the goal image", kind.least)
    return TaughtGoal(task.camera, image.pixels, owned(pixels), joints, task.target)
