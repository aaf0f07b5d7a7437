"""A tracking tube that a task names: read from its folder, added to every margin."""

import numpy as np
import pytest
from tests.runs.changed_task import shipped, written

from omniservo.errors import InputError
from omniservo.robots import CAMERA_HOUSING, ArmBodies, TrackingTube, load_arm
from omniservo.runs.arm_setting_of import TRACKING_PART, arm_setting_of
from omniservo.runs.plan_task import problem_of
from omniservo.runs.safety_of_task import safety_of_task
from omniservo.scenes.scene_of_task import scene_of_task
from omniservo.tasks import load_task

SHAPE = {"joints": 0.03, "links": 0.004, "position": 0.003, "image": 1.5}


@pytest.fixture
def folder(tmp_path):
    arm = load_arm("rx60")
    parts = ArmBodies(arm, mounted=CAMERA_HOUSING).tube_parts
    shape = [*[SHAPE["joints"]] * 6, *[SHAPE["links"]] * len(parts), 0.003, 1.5]
    TrackingTube("rx60", parts, np.array(shape), np.linspace(0.01, 1.0, 199), 0.07, "made up").save(
        tmp_path / "tube.json"
    )
    return tmp_path


def task_with(folder, **planning):
    document = shipped("whole-arm-1")
    document["planning"].pop("tracking_margin")
    document["planning"] |= {"tracking_tube": "tube.json"} | planning
    return load_task(written(folder, document))


def test_the_tube_is_added_to_every_margin_whatever_the_units_of_the_task_are(folder):
    task = task_with(folder)
    goal = task.teach.initial_T_goal.transform
    points = np.array([dot.center for dot in task.target.dots])
    problem = problem_of(task, goal, points)
    plain = load_task("whole-arm-1")
    asked = problem_of(plain, goal, points)
    share = 198 / 199  # of the ratios, the second largest: a probability of 1% of 199 runs
    box, was = problem.obstacles[0], asked.obstacles[0]  # grown, so that lines of sight keep off, too
    gained = box.clearance + (box.half_extents - was.half_extents).max()
    assert gained == pytest.approx(share * 0.003, rel=1e-2)
    assert problem.clearance == pytest.approx(share * 0.003, rel=1e-2)
    assert problem.least_distance == pytest.approx(asked.least_distance + share * 0.003, rel=1e-2)
    assert problem.visibility_margin == pytest.approx(asked.visibility_margin + share * 1.5, rel=1e-2)
    setting = arm_setting_of(task, scene_of_task(task))
    assert setting.limit_reserve == pytest.approx(share * 0.03, rel=1e-2)
    assert setting.singular_value == 0.07
    bodies = setting.bodies(problem.obstacles)
    around = np.where([bodies.is_around(i) for i in range(len(bodies.pairs))], 0.005, 0.0)
    added = bodies.asked(0.005, 0.0) - around
    beside = np.diff(bodies.shapes.carried[bodies.pairs], axis=1)[:, 0] == 1  # they stray as their joint does
    beside &= np.array([not bodies.is_around(i) for i in range(len(bodies.pairs))])
    moved = (added > 0.0) & ~beside  # but for shapes that turn about their own axis
    assert moved[~beside].mean() > 0.9
    assert added[moved] == pytest.approx(share * 0.004, rel=1e-2)


def test_a_part_of_the_risk_is_the_trackings(folder):
    tube = arm_setting_of(task := task_with(folder, risk=0.02), scene_of_task(task)).tube
    assert tube.share == TRACKING_PART * 0.02
    with pytest.raises(InputError, match="199 runs .* 999 are needed"):
        arm_setting_of(rare := task_with(folder, risk=0.002), scene_of_task(rare))


def test_a_tube_and_a_margin_together_and_a_tube_that_is_not_there_are_refused(folder):
    with pytest.raises(InputError, match="tracking_margin or tracking_tube"):
        task_with(folder, tracking_margin=3)
    with pytest.raises(InputError, match="elsewhere"):
        task_with(folder, tracking_tube="elsewhere.json")
    with pytest.raises(InputError, match="tracking_tube"):
        task_with(folder, tracking_tube="../tube.json")


def test_a_run_plans_with_more_room_to_joint_limits_than_the_supervisor_stops_it_at():
    task = load_task("whole-arm-1")
    scene = scene_of_task(task)
    reserve = safety_of_task(task).joint_reserve
    assert arm_setting_of(task, scene).limit_reserve > 2.0 * reserve
    # a move that joints lead deviates by nothing that noise does
    assert arm_setting_of(task, scene, with_tube=False).limit_reserve >= reserve
