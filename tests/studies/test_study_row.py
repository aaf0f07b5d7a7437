import math
from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import RigidTransform, Rotation
from tests.studies.conftest import rows_of, written

from omniservo.cameras import preset
from omniservo.planning import Sphere
from omniservo.studies import load_study, run_row
from omniservo.studies.closed_loop import ClosedLoop
from omniservo.studies.free_carrier import HOLD, exponential_map
from omniservo.studies.study_camera import StudyCamera
from omniservo.studies.study_controller import Led
from omniservo.studies.study_row import scored
from omniservo.studies.study_scene import draw_scene, generators
from omniservo.studies.trajectory import Trajectory


@pytest.fixture(scope="module")
def clean(tmp_path_factory):
    """A study without any fault, with time to arrive; its starts turned by 30 to 60 degrees."""
    text = """
format: omniservo.study/1
name: clean
units: {angle: deg}
scenes: 6
cameras: [fe185]
methods: [certified, ibvs, pbvs]
start: {rotation: {uniform: [30, 60]}}
images: {noise: 0, latency: 0}
servo: {tolerance_px: 0.02}
"""
    return load_study(written(tmp_path_factory.mktemp("clean"), text))


@pytest.fixture(scope="module")
def scene(clean):
    return draw_scene(clean, 0, preset("fe185"))


def test_without_noise_every_method_comes_to_the_goal(clean):
    rows = [run_row(clean, number).row for number in range(6)]
    assert [row.status for row in rows] == ["converged"] * 6
    assert all(row.success and not row.collision for row in rows)
    assert max(row.final_translation_error_m for row in rows) < 1e-3
    assert [row.certified for row in rows] == [True, False, False] * 2


def test_all_methods_of_a_scene_meet_the_same_scene(study, undisturbed):
    rows = rows_of(undisturbed)
    drawn = [(row.start_rotation_rad, row.start_distance_m, row.noise_px, row.obstacles) for row in rows]
    assert [len(set(drawn[k : k + 3])) for k in range(0, len(rows), 3)] == [1] * (len(rows) // 3)
    assert len(set(drawn)) == len(rows) // 3


def test_a_scene_is_as_it_was_drawn(study):
    for number in range(6):
        camera = list(study.cameras.values())[number % 2]
        scene = draw_scene(study, number, camera)
        goal = scene.initial_T_goal
        middle = scene.points.mean(axis=0)
        assert goal.rotation.magnitude() == pytest.approx(scene.drawn.rotation)
        assert math.radians(5) <= scene.drawn.rotation <= math.radians(60)
        far = scene.drawn.distance_ratio * scene.drawn.distance
        assert np.linalg.norm(middle) == pytest.approx(far, abs=scene.drawn.size / 2)
        for pose in (RigidTransform.identity(), goal):
            _, seen = scene.shown(pose.inv().apply(scene.points))
            assert seen.all()
            assert not scene.hidden(scene.points, np.array(pose.translation)).any()
        for ball in scene.obstacles:
            ends = np.linalg.norm(ball.center), np.linalg.norm(ball.center - goal.translation)
            assert min(ends) > ball.radius + study.obstacles.clearance


def test_a_start_that_sees_nothing_is_a_row_that_says_so(tmp_path):
    study = load_study(written(tmp_path, target="{off_axis: 80}", cameras="[perspective]"))
    row = run_row(study, 0).row
    assert (row.status, row.success, row.counts) == ("no_scene", False, False)
    assert "an end does not see all points" in row.reason


def test_a_crash_is_a_row_with_its_error(study, monkeypatch):
    def broken(*given):
        raise ZeroDivisionError("planted")

    monkeypatch.setattr("omniservo.studies.study_row.controller_of_scene", broken)
    row = run_row(study, 4).row
    assert row.status == "error"
    assert row.reason.startswith("ZeroDivisionError: planted (test_study_row.py:")
    assert (row.row, row.method, row.success, row.counts) == (4, "ibvs", False, True)


def test_an_exit_of_a_method_and_a_number_that_is_none_are_rows_too(study, monkeypatch):
    def leaves(*given):
        raise SystemExit(3)

    def no_number(study, scene, row, trajectory):
        return replace(row, final_translation_error_m=math.nan)

    with monkeypatch.context() as planted:
        planted.setattr("omniservo.studies.study_row.controller_of_scene", leaves)
        assert run_row(study, 4).row.reason.startswith("SystemExit: 3 (")
    monkeypatch.setattr("omniservo.studies.study_row.scored", no_number)
    row = run_row(study, 4).row
    assert row.reason.startswith("ValueError: final_translation_error_m is nan (")
    assert (row.status, row.final_translation_error_m, row.success) == ("error", None, False)


def test_a_reason_is_of_one_line_that_every_table_holds(study, monkeypatch):
    def broken(*given):
        raise ValueError("a\nb\x1b[31m\ud800" + "x" * 10_000)

    monkeypatch.setattr("omniservo.studies.study_row.controller_of_scene", broken)
    reason = run_row(study, 4).row.reason
    assert reason.isprintable()
    assert len(reason) <= 500
    assert reason.encode().decode() == reason


def test_another_seed_has_another_field_of_the_camera_model_s_error(tmp_path):
    pixels = np.array([[100.0, 100.0], [300.0, 200.0]])
    fields = []
    for seed in (1, 2):
        study = load_study(written(tmp_path, seed=seed, errors="{model: 1.0}"))
        fields.append(draw_scene(study, 0, study.cameras["fe185"]).lens.at(pixels))
    assert np.abs(fields[0] - fields[1]).max() > 0.1


def test_a_distance_stated_as_none_is_no_estimate(tmp_path):
    row = run_row(load_study(written(tmp_path, errors="{depth: -1}")), 1).row
    assert (row.status, row.reason) == ("not_estimated", "the distance of the two views is stated as 0 m")


def test_a_hidden_point_is_behind_a_ball_and_not_before_it(scene):
    centre, point = np.zeros(3), scene.points[0]
    between = replace(scene, obstacles=(Sphere(0.5 * point, 0.01),))
    beyond = replace(scene, obstacles=(Sphere(1.5 * point, 0.01),))
    assert between.hidden(scene.points, centre)[0]
    assert not beyond.hidden(scene.points, centre)[0]


class Constant:
    """Commands one twist, and notes when it was called."""

    done = False

    def __init__(self, twist):
        self.twist, self.times, self.acts = np.array(twist), [], []

    def step(self, time, pixels, valid, acts_at=None):
        self.times.append(time)
        self.acts.append(acts_at)
        return self.twist


def looped(study, scene, twist, **conditions):
    """Return the controller and trajectory of a scene under these conditions."""
    scene = replace(scene, conditions=replace(scene.conditions, **conditions))
    controller = Constant(twist)
    led = Led(controller, np.arange(len(scene.points)), None)
    ended = ClosedLoop(study, scene, StudyCamera(scene, generators(study, 0)[1]), led).run()
    return controller, ended.trajectory


def test_a_twist_acts_from_the_arrival_of_its_image_by_the_exponential_map(clean, scene):
    linear, angular = np.array([0.02, -0.01, 0.03]), np.array([0.05, 0.02, -0.04])
    _, trajectory = looped(clean, scene, [*linear, *angular], latency=0.1)
    last, elapsed = trajectory.end, trajectory.times[-1] - 0.1
    rotation, centre = Rotation.identity(), np.zeros(3)
    small = Rotation.from_rotvec(angular * elapsed / 200)
    for _ in range(200):  # midpoint rule, another way than the exponential map
        half = rotation * Rotation.from_rotvec(0.5 * angular * elapsed / 200)
        centre = centre + half.apply(linear) * elapsed / 200
        rotation = rotation * small
    assert np.allclose(last.translation, centre, atol=1e-6)
    assert (last.rotation.inv() * rotation).magnitude() < 1e-9


def test_with_few_images_the_way_is_noted_all_the_same(clean, scene):
    linear, angular = np.array([0.4, 0.0, 0.0]), np.array([0.0, 0.0, 1.5])
    few = clean.model_copy(update={"images": clean.images.model_copy(update={"rate": 4.0})})
    _, trajectory = looped(few, scene, [*linear, *angular])
    radius, middle = 0.4 / 1.5, np.array([0.0, 0.4 / 1.5, 0.0])
    off = np.linalg.norm(trajectory.centres - middle, axis=1)
    assert np.allclose(off, radius, atol=1e-9)
    halfway = 0.5 * (trajectory.centres[1:] + trajectory.centres[:-1])
    assert radius - np.linalg.norm(halfway - middle, axis=1).min() < 1e-4


def test_images_that_never_arrive_leave_the_camera_standing(clean, scene):
    controller, trajectory = looped(clean, scene, [0.1, 0, 0, 0, 0, 0], dropped=1.0)
    assert controller.times == []
    assert trajectory.length == 0.0


def test_a_twist_acts_no_longer_than_it_is_held(clean, scene):
    controller = Constant([0.1, 0, 0, 0, 0, 0])
    led = Led(controller, np.arange(len(scene.points)), None)
    camera = StudyCamera(scene, generators(clean, 0)[1])
    arrivals = iter([0.0])
    camera.arrival = lambda exposed: next(arrivals, None)
    trajectory = ClosedLoop(clean, scene, camera, led).run().trajectory
    assert len(controller.times) == 1
    assert trajectory.length == pytest.approx(0.1 * HOLD)


def test_a_late_image_is_not_used_after_a_newer_one(clean, scene):
    controller, _ = looped(clean, scene, [0, 0, 0, 0, 0, 0], delayed=0.5, delay=0.3)
    assert controller.times == sorted(set(controller.times))
    assert 100 < len(controller.times) < 420
    late = np.array(controller.acts) - np.array(controller.times)
    assert late.min() == pytest.approx(0.5 / 30)


def test_noise_lost_and_wrong_points_are_as_often_as_stated(clean, scene):
    stated = replace(scene.conditions, noise=0.2, lost=0.2, wrong=0.1)
    camera = StudyCamera(replace(scene, conditions=stated), np.random.default_rng(3))
    true, _ = scene.shown(scene.points)
    images = [camera.take(np.eye(3), np.zeros(3)) for _ in range(400)]
    found = np.array([image.found for image in images])
    off = np.array([image.pixels - true for image in images])[found]
    wrong = np.linalg.norm(off, axis=1) > 1.5
    assert found.mean() == pytest.approx(0.8, abs=0.02)
    assert wrong.mean() == pytest.approx(0.1, abs=0.015)
    assert off[~wrong].std() == pytest.approx(0.2, rel=0.05)


def test_a_point_is_not_taken_for_one_that_is_hidden(scene):
    hiding = replace(scene, obstacles=(Sphere(0.5 * scene.points[0], 0.01),))
    hidden = hiding.hidden(scene.points, np.zeros(3))
    true, _ = scene.shown(scene.points)
    stated = replace(scene.conditions, noise=0.0, lost=0.0, wrong=0.9)
    camera = StudyCamera(replace(hiding, conditions=stated), np.random.default_rng(3))
    for _ in range(20):
        image = camera.take(np.eye(3), np.zeros(3))
        off = np.linalg.norm(image.pixels[image.found][:, None] - true[hidden], axis=2)
        assert off.min() > 1e-6
        assert not image.found[hidden].any()


def test_calibration_and_model_errors_move_what_is_shown(scene):
    far = scene.points / np.linalg.norm(scene.points, axis=1)[:, None]
    true, _ = scene.shown(far)
    middle = np.array([(659 - 1) / 2, (432 - 1) / 2])
    wrong = replace(scene, conditions=replace(scene.conditions, focal=0.01, centre=(2.0, -1.0)))
    shown, _ = wrong.shown(far)
    assert np.allclose(shown - true, 0.01 * (true - middle) + [2.0, -1.0])


@pytest.mark.parametrize("angle", [0.0, 1e-9, 1e-4, 0.0199, 0.0201, 0.5, 3.0])
def test_a_step_is_scipy_s_exponential_map(angle):
    axis = np.array([0.48, -0.6, 0.64])
    motion = np.concatenate(([0.3, -0.2, 0.1], angle * axis))
    rotation, translation = exponential_map(motion)
    known = RigidTransform.from_exp_coords(np.concatenate((motion[3:], motion[:3]))).as_matrix()
    assert np.allclose(rotation, known[:3, :3], rtol=0.0, atol=1e-14)
    assert np.allclose(translation, known[:3, 3], rtol=0.0, atol=1e-14)


def along(poses):
    """Return the trajectory through poses."""
    rotations = [pose.rotation.as_matrix() for pose in poses]
    return Trajectory(list(range(len(poses))), rotations, [np.array(pose.translation) for pose in poses])


@pytest.mark.parametrize(
    ("off_ball", "off_goal", "collision", "success"),
    [(0.029, 0.0, True, False), (0.031, 0.0, False, True), (0.031, 0.011, False, False)],
)
def test_success_is_near_the_goal_and_clear_of_every_ball(
    clean, scene, off_ball, off_goal, collision, success
):
    goal = scene.initial_T_goal
    end = RigidTransform.from_translation([off_goal, 0.0, 0.0])
    half = 0.5 * np.array(goal.translation)
    across = np.cross(half, [1.0, 0.0, 0.0])
    ball = Sphere(half + (0.02 + off_ball) * across / np.linalg.norm(across), 0.02)
    trajectory = along([RigidTransform.identity(), goal, end * goal])
    empty = run_row(clean, 0).row
    row = scored(clean, replace(scene, obstacles=(ball,)), empty, trajectory)
    assert (row.collision, row.success) == (collision, success)
    assert row.final_translation_error_m == pytest.approx(off_goal, abs=1e-12)


@pytest.mark.parametrize(
    ("times", "end", "diverged"), [(1.99, 1.5, False), (2.01, 1.5, True), (2.01, 0.0, False)]
)
def test_a_camera_diverged_that_was_led_away_and_is_not_at_the_goal(clean, scene, times, end, diverged):
    goal = np.array(scene.initial_T_goal.translation)
    far = max(np.linalg.norm(goal), scene.drawn.distance)
    places = [goal + far * np.array([share, 0.0, 0.0]) for share in (times, end)]
    turn = scene.initial_T_goal.rotation
    way = [RigidTransform.identity(), *(RigidTransform.from_components(place, turn) for place in places)]
    row = scored(clean, scene, run_row(clean, 0).row, along(way))
    assert row.diverged is diverged


def test_the_gap_is_that_of_the_way_between_images_too(scene):
    trajectory = along([RigidTransform.from_translation([x, 0.0, 0.0]) for x in (0.0, 1.0)])
    beside = replace(scene, obstacles=(Sphere([0.5, 0.3, 0.0], 0.1),))
    assert trajectory.least_gap(beside) == pytest.approx(0.2)
    assert trajectory.least_gap(replace(scene, obstacles=())) is None


def test_a_depth_stated_wrongly_ends_off_the_goal_by_no_more_than_the_image_allows(tmp_path):
    """A wrong scale leaves the directions: the goal image is reached all the same."""
    fields = {"errors": "{depth: 0.05}", "images": "{noise: 0, latency: 0}", "limits": "{seconds: 12}"}
    study = load_study(written(tmp_path, **fields, obstacles="{count: 0}", scenes=1, cameras="[fe185]"))
    rows = [run_row(study, number).row for number in range(3)]
    assert [row.success for row in rows] == [True] * 3
