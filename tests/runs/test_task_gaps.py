"""The arm of a task is watched among the obstacles as they are known now."""

import numpy as np
import pytest
from tests.tracking.test_replanner import following

from omniservo.planning import Sphere
from omniservo.robots import RobotState
from omniservo.runs.arm_setting_of import arm_setting_of
from omniservo.runs.safety_of_task import safety_of_task
from omniservo.runs.task_gaps import TaskGaps
from omniservo.safety.gap_watch import TooNear
from omniservo.scenes.scene_of_task import scene_of_task
from omniservo.tasks import load_task


def test_an_obstacle_that_was_put_elsewhere_is_watched_there():
    task = load_task("whole-arm-2")
    scene, (_, replanner) = scene_of_task(task), following()
    joints = np.asarray(scene.start_joints)
    standing = RobotState(0.0, joints, np.zeros_like(joints))
    setting = arm_setting_of(task, scene, with_tube=False)
    bodies = setting.bodies(())
    forearm = bodies.corners(joints)[bodies.shapes_of("forearm")].mean(axis=(0, 1))
    away = Sphere([0.0, 5.0, 0.0], 0.02)
    ball = Sphere(setting.base_T_initial.inv().apply(forearm), 0.02)

    replanner.set_obstacles([away])
    gaps = TaskGaps(task, scene, safety_of_task(task), replanner)
    gaps.check(standing)
    replanner.set_obstacles([ball])
    with pytest.raises(TooNear, match="forearm and obstacle 0"):
        gaps.check(standing)
    replanner.set_obstacles([away])
    gaps.check(standing)
