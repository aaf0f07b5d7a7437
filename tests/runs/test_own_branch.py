"""The arm's own branch: from where it stands; what stops it is said with what would do instead."""

import json
import re

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from omniservo.errors import NoSolutionError
from omniservo.planning import CameraPath
from omniservo.runs.own_branch import own_branch
from omniservo.scenes.scene_of_task import scene_of_task
from omniservo.tasks import load_task


def standing(name, near_deg):
    """A shipped task with the arm in another posture at the same camera pose."""
    task = load_task(name)
    start = task.start.model_copy(update={"joints_near": tuple(np.deg2rad(near_deg))})
    return task.model_copy(update={"start": start})


def to_goal(task):
    """The straight way to where the goal is taught."""
    goal = task.teach.initial_T_goal.transform
    quaternion = goal.rotation.as_quat()
    rotation = np.column_stack([quaternion - [0, 0, 0, 1], [0, 0, 0, 1]])
    return CameraPath(rotation, np.column_stack([goal.translation, np.zeros(3)]))


@pytest.mark.parametrize("name", ["paper-example-1", "ur5e-table", "panda-table"])
def test_own_branch_goes_from_the_start_joints_to_the_goal(name):
    task = load_task(name)
    scene = scene_of_task(task)
    branch = own_branch(task, scene, to_goal(task))
    np.testing.assert_allclose(branch(0.0), scene.start_joints, atol=1e-8)
    world_T_goal = task.start.world_T_camera.transform * task.teach.initial_T_goal.transform
    off = world_T_goal.inv() * scene.world_T_camera(branch(1.0))
    assert np.linalg.norm(off.translation) < 1e-6
    assert off.rotation.magnitude() < 1e-6


def turning(angle_deg):
    """The camera turns about its own axis."""
    turned = Rotation.from_euler("z", angle_deg, degrees=True).as_quat()
    return CameraPath(np.column_stack([turned - [0, 0, 0, 1], [0, 0, 0, 1]]), np.zeros((3, 1)))


def test_a_posture_a_full_turn_away_names_the_joint_and_a_start_that_would_do():
    """The camera turns by 60 deg, and joint 6 with it, which stands 0.8 deg from its end."""
    near = [-91, -166, 50, 26, -90, 359]
    task = standing("ur5e-table", near)
    with pytest.raises(NoSolutionError) as no:
        own_branch(task, scene_of_task(task), turning(60))
    said = str(no.value)
    room = 360 - np.rad2deg(scene_of_task(task).start_joints[5])
    assert re.search(r"wrist_3 passes its limit from w = 0.01\d\d on, by [\d.]+ deg at w = 1", said)
    assert f"by {60 - room:.2f} deg" in said
    start = json.loads(re.search(r"it can from start.joints_near = (\[.*\]) deg", said)[1])
    other = standing("ur5e-table", start)
    assert own_branch(other, scene_of_task(other), turning(60)).feasible
    assert own_branch(task, scene_of_task(task), turning(-60)).feasible


@pytest.mark.parametrize(
    ("name", "words"),
    [
        ("ur5e-table", "nor can it on any of its 8 branches"),
        ("panda-table", r"nor can it on any of the \d branches that a search found, which may miss some"),
    ],
)
def test_a_path_out_of_every_branchs_reach_says_how_many_were_tried(name, words):
    task = load_task(name)
    away = CameraPath([[0.0], [0.0], [0.0], [1.0]], [[0.0, 0.0], [0.0, 0.0], [2.0, 0.0]])
    with pytest.raises(
        NoSolutionError, match=f"^the arm cannot follow the planned path: .* at w = .*; {words}$"
    ):
        own_branch(task, scene_of_task(task), away)
