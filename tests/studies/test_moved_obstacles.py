"""A ball that is put elsewhere on the way: what is true, what is scored, and who is given it."""

from dataclasses import replace

import numpy as np
import pytest
from tests.studies.conftest import written

from omniservo.planning import Sphere
from omniservo.studies import load_study, run_row
from omniservo.studies.closed_loop import ClosedLoop
from omniservo.studies.study_camera import StudyCamera
from omniservo.studies.study_controller import Led
from omniservo.studies.study_scene import MovedObstacles, NoScene, draw_scene, generators
from omniservo.studies.trajectory import Trajectory

FIELDS = {
    "cameras": "[fe185]",
    "scenes": 4,
    "methods": "[certified, certified-once]",
    "start": "{rotation: 30, distance_ratio: 1.4}",
    "obstacles": "{count: 1, radius: 0.04, aside: 0.02, moved: 1, moved_at: {uniform: [0.4, 0.8]}}",
    "images": "{noise: 0.1, latency: 0.02}",
    "errors": "{}",
    "limits": "{seconds: 6}",
}


@pytest.fixture(scope="module")
def study(tmp_path_factory):
    return load_study(written(tmp_path_factory.mktemp("moved"), **FIELDS))


@pytest.fixture(scope="module")
def scenes(study):
    """Those in which a ball is moved."""
    found = []
    for number in range(study.scenes):
        try:
            found.append(draw_scene(study, number, study.cameras["fe185"]))
        except NoScene:
            continue
    found = [scene for scene in found if scene.moved is not None]
    assert len(found) >= 2
    return found


def test_one_ball_is_elsewhere_clear_of_the_goal_when_an_image_is_taken(study, scenes):
    for scene in scenes:
        goal = np.array(scene.initial_T_goal.translation)
        changed = [b for a, b in zip(scene.obstacles, scene.moved.obstacles, strict=True) if a is not b]
        assert len(changed) == 1
        assert np.linalg.norm(changed[0].center - goal) > changed[0].radius + scene.clearance
        assert not scene.after_move.hidden(scene.points, goal).any()
        assert (scene.moved.time * study.images.rate) % 1.0 == pytest.approx(0.0, abs=1e-9)
        assert scene.moved.time >= 0.4


def test_the_rest_of_a_scene_is_that_of_a_study_in_which_nothing_moves(study, scenes, tmp_path):
    still = load_study(
        written(tmp_path, **FIELDS | {"obstacles": FIELDS["obstacles"].replace("moved: 1,", "")})
    )
    same = draw_scene(still, scenes[0].number, still.cameras["fe185"])
    assert same.moved is None
    assert np.array_equal(same.points, scenes[0].points)
    assert np.array_equal(same.obstacles[0].center, scenes[0].obstacles[0].center)


@pytest.mark.slow
def test_a_plan_made_again_collides_nowhere_and_the_first_one_does(study, scenes):
    numbers = {scene.number for scene in scenes}
    rows = [run_row(study, k).row for k in range(study.rows) if k // 2 in numbers]
    again, once = ([row for row in rows if row.method == method] for method in study.methods)
    assert not any(row.collision for row in again)
    assert any(row.success for row in again)
    assert any(row.collision for row in once)
    assert all(row.obstacle_moved_s is not None for row in rows)


def test_a_gap_is_to_where_the_ball_is_at_that_time(scenes):
    here, there = Sphere([0.0, 0.0, 0.0], 0.1), Sphere([5.0, 0.0, 0.0], 0.1)
    scene = replace(scenes[0], obstacles=(here,), moved=MovedObstacles(1.0, (there,)))
    times = [0.0, 0.5, 1.0, 1.5, 2.0]

    def gap(places):
        return Trajectory(times, [np.eye(3)] * 5, [np.array([x, 0.0, 0.0]) for x in places]).least_gap(scene)

    assert gap([2.0, 2.0, 2.0, 1.0, 0.0]) == pytest.approx(1.9)  # the ball was gone from there
    assert gap([3.0, 2.0, 3.0, 3.0, 3.0]) == pytest.approx(1.9)
    assert gap([2.0, 2.0, 2.0, 4.0, 4.0]) == pytest.approx(0.9)
    early = Trajectory(times[:2], [np.eye(3)] * 2, [np.array([5.0, 0.0, 0.0])] * 2)
    assert early.least_gap(scene) == pytest.approx(4.9)


class Standing:
    """Commands nothing."""

    done = False

    def step(self, time, pixels, valid, acts_at=None):
        return np.zeros(6)


def test_images_show_what_the_ball_hides_from_then_on_and_who_plans_again_is_given_it(study, scenes):
    before = Sphere([0.0, 0.0, -1.0], 0.02)
    hides = Sphere(0.5 * scenes[0].points[0], 0.01)
    scene = replace(scenes[0], obstacles=(before,), moved=MovedObstacles(0.5, (hides,)))
    given = []
    led = Led(Standing(), np.arange(len(scene.points)), None, given_obstacles=given.append)
    camera = StudyCamera(scene, generators(study, 0)[1])
    short = study.model_copy(update={"limits": study.limits.model_copy(update={"seconds": 0.4})})
    assert not ClosedLoop(short, scene, camera, led).run().trajectory.feature_lost
    assert given == []
    assert ClosedLoop(study, scene, camera, led).run().trajectory.feature_lost
    assert given == [(hides,)]
