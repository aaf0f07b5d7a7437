"""A start stated as joints is the pose that the arm has there."""

import numpy as np
import pytest

from omniservo.errors import InputError
from omniservo.robots import load_arm
from omniservo.scenes.scene_of_task import scene_of_task
from omniservo.tasks import load_task

TASK = """
format: omniservo.task/1
name: own-start
summary: An arm at joints that its owner has read
units: {length: mm, angle: deg}
camera: perspective
arm: {model: panda, foot: [100, 200, 300], flange_T_camera: {translation: [10, 20, 30]}}
start: {START}
teach: {initial_T_goal: {translation: [0, 0, 50]}}
scale: {tags: true}
target:
  tags: {dictionary: tag36h11, panels: [{id: 0, edge: 50, center: [0, 0, 400]}]}
"""
JOINTS = [10, -47, -15, -130, -16, 75, 25]


def task_with(folder, start):
    path = folder / "task.yaml"
    path.write_text(TASK.replace("{START}", start))
    return load_task(path)


def test_the_camera_is_where_the_joints_put_it(tmp_path):
    task, arm, q = task_with(tmp_path, f"{{joints: {JOINTS}}}"), load_arm("panda"), np.deg2rad(JOINTS)
    in_base = arm.base_T_flange(q).apply([0.01, 0.02, 0.03])
    found = task.start.world_T_camera.transform
    np.testing.assert_allclose(found.translation, np.add(in_base, [0.1, 0.2, 0.3]), atol=1e-12)
    turn = found.rotation.inv() * arm.base_T_flange(q).rotation
    assert turn.magnitude() < 1e-9
    np.testing.assert_allclose(scene_of_task(task).start_joints, q, atol=1e-9)


@pytest.mark.parametrize(
    ("start", "message"),
    [
        ("{joints: [1, 2, 3]}", "start.joints: 3 numbers given; panda has 7 joints: joint1, joint2"),
        ("{joints: [0, 0, 0, 10, 0, 75, 0]}", r"start.joints: joint4 at 10.0 deg; legal: -176.0 … -4.0 deg"),
        ("{joints: [0, 0, 0, here, 0, 75, 0]}", r"start.joints.3: .*; 'here' given"),
        ("{joints: [.nan, 0, 0, 0, 0, 75, 0]}", r"start.joints.0: .*finite"),
        (
            f"{{joints: {JOINTS}, joints_near: {JOINTS}}}",
            "start: joints, joints_near given; legal: joints, or world_T_camera with joints_near",
        ),
        ("{}", "start: nothing given; legal: joints, or world_T_camera with joints_near"),
    ],
)
def test_a_wrong_start_is_one_message(tmp_path, start, message):
    with pytest.raises(InputError, match=message) as raised:
        task_with(tmp_path, start)
    assert str(tmp_path / "task.yaml") in str(raised.value)
