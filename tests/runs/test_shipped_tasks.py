"""Every shipped task can be done: seen, estimated, planned, and followed by the arm past its obstacles."""

from functools import cache

import numpy as np
import pytest

from omniservo.estimation import estimate_two_view
from omniservo.looks.followed_points import followed_points
from omniservo.planning import CameraPath
from omniservo.robots import arm_clearance
from omniservo.runs import estimate_in_cell
from omniservo.runs.arm_setting_of import arm_setting_of
from omniservo.runs.own_branch import own_branch
from omniservo.runs.plan_task import plan_task
from omniservo.scenes.scene_of_task import scene_of_task
from omniservo.simulation import SimulatedCell, World
from omniservo.tasks import load_task, shipped_tasks
from omniservo.verification import verify_plan

NAMES = shipped_tasks()
ROOM = 0.005
"""[m] that the arm keeps from the obstacles on its planned way"""


@cache
def estimated(name):
    return estimate_in_cell(name, SimulatedCell)


@pytest.fixture(scope="module", params=NAMES)
def prepared(request):
    task = load_task(request.param)
    found = estimated(request.param)
    followed = followed_points(found.estimate, found.seen.matched.initial)
    return (
        task,
        found.estimate,
        *plan_task(task, scene_of_task(task), found.estimate, followed, "certified", 0),
    )


@pytest.mark.slow
def test_the_two_pictures_give_the_taught_motion(prepared):
    task, estimate, *_ = prepared
    true = task.teach.initial_T_goal.transform
    error = true.inv() * estimate.initial_T_goal
    # JPEG moves a tag's corner by several times what its fit can state; such a corner may be left out
    assert estimate.inliers.mean() > (0.9 if task.target.textures or task.sensor.jpeg else 0.999)
    assert np.linalg.norm(error.translation) < 1e-3
    assert error.rotation.magnitude() < np.deg2rad(0.2)


def test_natural_features_of_a_run_share_what_their_windows_do():
    found, camera = estimated("textured-object"), load_task("textured-object").camera
    matched = found.seen.matched
    alone = estimate_two_view(camera, matched.initial, matched.goal, noise=matched.noise)
    turn, turn_alone = (np.trace(e.covariance[3:, 3:]) for e in (found.estimate, alone))
    assert turn > 1.3 * turn_alone


def test_the_plan_is_certified_and_independently_verified(prepared):
    assert prepared[2].status == "certified"
    assert verify_plan(prepared[2]).status == "certified"


def test_the_arm_follows_the_plan_with_room_to_every_obstacle(prepared):
    task, _, plan, _ = prepared
    scene = scene_of_task(task)
    world = World(scene)
    for joints in own_branch(task, scene, plan.path)(np.linspace(0, 1, 41)):
        data = world.data_at(joints)
        assert world.arm_obstacle_distance(data) > ROOM
        assert not world.touching(data)


def test_an_obstacle_stands_in_the_straight_way(prepared):
    task, _, plan, _ = prepared
    goal = task.teach.initial_T_goal.transform.translation
    straight = np.linspace(0, 1, 201)[:, None] * goal
    known = task.known_obstacles(np.inf)
    gaps = [o.obstacle.distance(straight).min() for o in known if o.clearance is None]
    assert min(gaps) < task.planning.clearance or not _whole_arm_is_clear(task, plan, straight)
    assert len(plan.path.translation[0]) > 2 or task.moves


def _whole_arm_is_clear(task, plan, straight):
    """Of the straight way, with the goal's rotation turned evenly."""
    scene = scene_of_task(task)
    setting = arm_setting_of(task, scene)
    goal = plan.problem.goal_quaternion
    path = CameraPath(
        np.column_stack([goal - [0, 0, 0, 1], [0, 0, 0, 1]]), np.column_stack([straight[-1], np.zeros(3)])
    )
    joints = own_branch(task, scene, path)
    found = arm_clearance(setting.bodies(plan.problem.obstacles), joints, clearance=setting.clearance)
    return found.status == "clear"


def test_a_task_with_a_stated_risk_is_planned_with_more_than_it_asks_for(prepared):
    task, _, plan, risk = prepared
    assert (risk is None) == (task.planning.risk is None)
    if risk is not None:
        assert risk.ok
        assert risk.predicted_bound <= task.planning.risk
        asked = task.planning.clearance + task.planning.tracking_margin
        assert plan.least_clearance(task.planning.common_obstacles) > asked + 0.001
        assert plan.least_visibility() >= task.planning.visibility_margin + risk.extra_visibility
