"""A plan on which the arm hides its own target is refused where sight is asked for."""

from types import SimpleNamespace

import numpy as np
import pytest
from tests.robots.joint_paths import straight_joint_path

from omniservo.errors import AnswerIsNo
from omniservo.runs.own_branch import base_T_initial
from omniservo.runs.refuse_hidden import refuse_hidden
from omniservo.simulation.scene_of_task import scene_of_task
from omniservo.tasks import load_task


def test_a_target_behind_the_arm_is_refused_by_the_link_that_hides_it():
    task = load_task("whole-arm-1")
    scene = scene_of_task(task)
    joints = straight_joint_path(scene.start_joints, scene.start_joints + 0.05)
    behind = base_T_initial(task, scene).inv().apply(np.array([[-0.2, 0.0, 0.2]]))  # of the base's column
    ahead = np.array([[0.0, 0.0, 0.4]])

    def plan(points):
        return SimpleNamespace(problem=SimpleNamespace(points=points))

    motion = SimpleNamespace(joints=joints)
    refuse_hidden(task, scene, plan(ahead), motion)
    with pytest.raises(AnswerIsNo, match=r"hides its own target: \w+ stands .* point 1 at w = 0\."):
        refuse_hidden(task, scene, plan(np.vstack([ahead, behind])), motion)
    anything = task.model_copy(update={"planning": task.planning.model_copy(update={"occlusion": False})})
    refuse_hidden(anything, scene, plan(behind), motion)
