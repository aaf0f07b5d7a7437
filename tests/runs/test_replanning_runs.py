"""A panel is pushed into the way of a moving arm, from pixels on: it goes round, or it stops before."""

import numpy as np
import pytest
from tests.runs.changed_task import DrawnCell

from omniservo.runs import run_task
from omniservo.runs.moves import Moves
from omniservo.runs.run_task import _truth
from omniservo.scenes.scene_of_task import scene_of_task
from omniservo.simulation import SimulatedCell, World
from omniservo.tasks import TaughtGoal, load_task
from omniservo.verification import verify_plan


def run(time):
    """The shipped task with the panel pushed at another time, and fewer pictures."""
    task = load_task("moving-panel")
    sensor = task.sensor.model_copy(update={"rate": 12.0})
    moves = (task.moves[0].model_copy(update={"time": time}),)
    return run_task(task.model_copy(update={"sensor": sensor, "moves": moves}), DrawnCell, filmed=False)


@pytest.fixture(scope="module")
def gone_round():
    return run(0.75)


def true_gaps(result):
    """MuJoCo's distance of every logged posture to the obstacle as it stood then."""
    scene = scene_of_task(result.task)
    before, after = World(scene), World(scene)
    shift = result.task.start.world_T_camera.transform.rotation.apply(np.array(result.task.moves[0].by))
    geom = after.obstacle_geoms[0]
    after.model.body_pos[after.model.geom_bodyid[geom]] += shift
    moved = [row.time >= result.task.moves[0].time for row in result.log.rows]
    return np.array(
        [
            (after if late else before).arm_obstacle_distance(
                (after if late else before).data_at(np.array(row.joints))
            )
            for row, late in zip(result.log.rows, moved, strict=True)
        ]
    ), np.array(moved)


@pytest.mark.slow
def test_it_goes_round_without_stopping_and_converges(gone_round):
    metrics, task = gone_round.metrics, gone_round.task
    assert (metrics["status"], metrics["contacts"]) == ("converged", [])
    assert (metrics["changes_on_the_way"], metrics["replanned"]) == (1, 1)
    assert metrics["final_translation_error_m"] <= 0.3e-3
    assert metrics["clearance_executed_m"] >= task.planning.clearance
    rows, event = gone_round.log.rows, gone_round.replannings[0]
    speeds = [np.abs(r.joint_velocities).max() for r in rows if abs(r.time - event.leg.time) < 0.3]
    assert min(speeds) > 0.03
    assert {row.leg for row in rows} == {0, 1}


@pytest.mark.slow
def test_every_link_keeps_its_clearance_from_where_the_panel_was_and_is(gone_round):
    gaps, moved = true_gaps(gone_round)
    assert gaps.min() >= gone_round.task.planning.arm_clearance
    assert gaps == pytest.approx(gone_round.log.column("arm_clearance"), abs=0.004)
    assert moved.any()
    assert not moved.all()


@pytest.mark.slow
def test_the_first_plan_would_have_led_through_the_panel(gone_round):
    known = gone_round.task.known_obstacles(np.inf)[0].obstacle
    assert known.distance(gone_round.plan.path.positions(np.linspace(0, 1, 201))).min() < 0.0


@pytest.mark.slow
def test_commands_do_not_jump_where_the_other_way_is_taken_up(gone_round):
    metrics, log = gone_round.metrics, gone_round.log
    assert metrics["replanning_twist_jump"] < 1e-8
    assert metrics["replanning_joint_jump"] < 1e-6
    joints, time = log.column("joint_velocities"), log.column("time")
    steps = np.abs(np.diff(joints, axis=0)).max(axis=1) / np.diff(time)
    taken = gone_round.replannings[0].leg.time
    at = int(np.searchsorted(time, taken))
    assert steps[at - 2 : at + 2].max() <= 1.2 * steps.max()
    assert steps.max() <= 0.5 * scene_of_task(gone_round.task).arm.joint_acceleration.min()


@pytest.mark.slow
def test_both_plans_are_verified_independently(gone_round):
    for plan in (gone_round.plan, gone_round.replannings[0].plan):
        assert verify_plan(plan).status == "certified"


def test_a_panel_pushed_right_before_the_camera_stops_the_arm_before_contact():
    result = run(1.3)
    metrics = result.metrics
    assert (metrics["status"], metrics["contacts"]) == ("stopped", [])
    assert result.log.stop_reason == "blocked"
    assert "no way on is proven" in metrics["reason"]
    assert metrics["arm_clearance_executed_m"] > 0.0
    assert result.replannings[-1].outcome == "blocked"
    assert len(result.way.legs) == 1


def test_a_body_that_is_moved_twice_is_drawn_where_it_came_to_stand():
    task = load_task("moving-panel")
    first = task.moves[0]
    moves = (first.model_copy(update={"time": 2.0, "by": (0.0, 0.0, 0.05)}), first)
    task = task.model_copy(update={"moves": moves})
    cell, empty = SimulatedCell(task), np.zeros((0, 2))
    left = Moves(task, cell.move_obstacles, None)
    left.at(2.0)
    stands = task.start.world_T_camera.transform.inv().apply(cell.robot.world.scene.obstacles[0].corners)
    goal = TaughtGoal(task.camera, np.zeros((1, 1), np.uint8), empty, None)
    drawn = _truth(task, cell.scene, goal, np.zeros((0, 3))).obstacle_corners
    np.testing.assert_allclose(drawn[-1], stands, atol=1e-9)
    np.testing.assert_allclose(drawn[-2], drawn[0] + first.by)
