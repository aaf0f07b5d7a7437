"""What the public benchmark rests on: scenes all over the image, plans at a stated risk, time to settle."""

from dataclasses import replace

import numpy as np
import pytest
from tests.studies.conftest import written

from omniservo.cameras.widest_angle import widest_angle
from omniservo.reporting.study_figures import study_drawings
from omniservo.run_methods import METHODS
from omniservo.studies import PACKAGE, StudyTally, load_study, run_row
from omniservo.studies.closed_loop import SETTLING, ClosedLoop
from omniservo.studies.replanned_tracker import ReplannedTracker
from omniservo.studies.scene_start import estimate_of_scene, scene_start
from omniservo.studies.study_camera import StudyCamera
from omniservo.studies.study_controller import Led, controller_of_scene
from omniservo.studies.study_scene import NoScene, generators
from omniservo.tracking import PathTracker


@pytest.fixture(scope="module")
def benchmark():
    return load_study("paper-benchmark")


def starts(study, camera, count):
    """Return the first starts of scenes with this camera that exist."""
    place = list(study.cameras).index(camera)
    found = (scene_start(study, place + k * len(study.cameras), camera) for k in range(count))
    return [start for start in found if not isinstance(start, NoScene)]


def test_it_has_six_cameras_and_all_methods_and_starts_to_180_degrees_and_twice_the_distance(benchmark):
    assert len(benchmark.cameras) == 6
    assert set(benchmark.methods) == set(METHODS)
    assert benchmark.start.rotation.bounds[1] == pytest.approx(np.pi)
    assert benchmark.start.distance_ratio.bounds[1] == 2.0
    assert widest_angle(benchmark.cameras["fisheye-220"]) == pytest.approx(np.deg2rad(110), abs=1e-3)


def test_wide_cameras_have_targets_past_90_degrees_and_with_and_without_obstacles(benchmark):
    scenes = [start.scene for start in starts(benchmark, "fisheye-220", 12)]
    ends = [(s.points, s.initial_T_goal.inv().apply(s.points)) for s in scenes]
    past = [any((end[:, 2] < 0.0).any() for end in both) for both in ends]
    assert 2 <= sum(past) < len(scenes)
    assert len({bool(scene.obstacles) for scene in scenes}) == 2


def test_a_view_share_of_one_has_the_cube_touch_the_widest_angle(tmp_path):
    fields = {"target": "{view_share: 1, size: 0.2, distance: 0.6}", "errors": "{}"}
    study = load_study(
        written(tmp_path, **fields, cameras="[fe185]", start="{view_share: 0.5, rotation: 20}")
    )
    drawn = scene_start(study, 0, "fe185").scene.drawn
    widest = widest_angle(study.cameras["fe185"])
    assert drawn.goal_off_axis == pytest.approx(widest - np.arcsin(0.1 * np.sqrt(3) / 0.6))
    corner = 0.1 * np.sqrt(3) / (0.6 * drawn.distance_ratio)
    assert drawn.start_off_axis == pytest.approx(0.5 * (widest - np.arcsin(corner)))


@pytest.fixture(scope="module")
def uncertain(tmp_path_factory):
    """A study with a ball on the straight line, a distance known to 3%, and the first start that has both."""
    fields = {
        "cameras": "[perspective]",
        "obstacles": "{count: 1, radius: 0.02, aside: 0}",
        "images": "{noise: 0.2}",
        "errors": "{depth: {normal: [0, 0.03]}}",
        "servo": "{risk: 0.02, depth_sigma: 0.03}",
    }
    study = load_study(written(tmp_path_factory.mktemp("uncertain"), **fields))
    return study, next(start for start in starts(study, "perspective", 9) if start.scene.obstacles)


def planned(study, start, **servo):
    """Return the certified plan for what is estimated with these settings."""
    study = study.model_copy(update={"servo": study.servo.model_copy(update=servo)})
    camera = StudyCamera(start.scene, generators(study, start.scene.number)[1])
    known = replace(start, estimated=estimate_of_scene(study, start.scene, camera))
    return controller_of_scene(study, known, PACKAGE, "certified").plan


def test_a_plan_at_a_stated_risk_keeps_more_than_one_that_takes_the_estimate_as_exact(uncertain):
    exact, risky = planned(*uncertain, risk=None), planned(*uncertain)
    assert risky.status == exact.status == "certified"
    assert risky.least_clearance([0]) > exact.least_clearance([0]) + 1e-3


def test_where_no_plan_keeps_the_risk_the_estimate_is_taken_as_exact(uncertain):
    exact, hopeless = planned(*uncertain, risk=None), planned(*uncertain, depth_sigma=0.5)
    assert np.array_equal(hopeless.path.translation, exact.path.translation)


def test_a_ball_that_is_not_aside_is_on_the_straight_line(uncertain):
    scene = uncertain[1].scene
    end, middle = np.array(scene.initial_T_goal.translation), scene.obstacles[0].center
    assert np.linalg.norm(np.cross(middle, end)) < 1e-12
    assert 0.3 <= middle @ end / (end @ end) <= 0.7


class Arrived:
    """Says from the first image on that it has arrived, and is still moving."""

    done = True

    def step(self, time, pixels, valid, acts_at=None):
        return np.array([0.01, 0.0, 0.0, 0.0, 0.0, 0.0])


def test_a_run_goes_on_for_a_while_after_its_controller_says_that_it_has_arrived(benchmark):
    start = starts(benchmark, "fe185", 1)[0]
    scene = replace(
        start.scene, conditions=replace(start.scene.conditions, latency=0.0, jitter=0.0, dropped=0.0)
    )
    led = Led(Arrived(), np.arange(len(scene.points)), None)
    ended = ClosedLoop(benchmark, scene, replace(start, scene=scene).camera(), led).run()
    assert ended.status == "converged"
    assert SETTLING <= ended.trajectory.times[-1] < SETTLING + 0.1
    assert ended.trajectory.length == pytest.approx(0.01 * ended.trajectory.times[-1], rel=0.02)


def test_the_map_of_many_runs_shows_shares_on_one_scale_and_grey_where_no_start_is(benchmark):
    row = replace(run_row(benchmark, 5).row, status="converged")
    starts = [(turn, ratio) for turn in np.linspace(0.1, 3.1, 25) for ratio in np.linspace(0.8, 2.0, 25)]
    rows = [
        replace(row, start_rotation_rad=turn, start_distance_ratio=ratio, success=bool(turn < 1.0))
        for turn, ratio in starts
        if turn < 2.0 or ratio > 1.4
    ]
    _, map_of_starts = study_drawings(StudyTally(rows))
    axes, scale = map_of_starts.figure.axes
    assert scale.get_ylabel() == "reach the goal [%]"
    shares = axes.collections[0].get_array().T  # by turn, then ratio
    assert np.ma.allclose(shares[0], 1.0)
    assert np.ma.allclose(shares[-1][shares.shape[1] // 2 + 1 :], 0.0)
    assert np.isnan(shares[-1].filled(np.nan)[0])
    assert axes.get_facecolor() != (1.0, 1.0, 1.0, 1.0)


def test_certified_plans_again_where_the_estimate_has_changed_and_certified_once_does_not(tmp_path):
    fields = {"errors": "{}", "images": "{noise: 0.6, latency: 0}", "limits": "{seconds: 1.5}", "scenes": 8}
    study = load_study(
        written(tmp_path, **fields, cameras="[fe185]", methods="[certified, certified-once]",
                obstacles="{count: 0}", start="{rotation: 90, distance_ratio: 1.5}")
    )  # fmt: skip
    changed = 0
    for start in starts(study, "fe185", study.scenes):
        led = controller_of_scene(study, start, PACKAGE, "certified")
        once = controller_of_scene(study, start, PACKAGE, "certified-once")
        assert isinstance(led.controller, ReplannedTracker)
        assert isinstance(once.controller, PathTracker)
        ClosedLoop(study, start.scene, start.camera(), led).run()
        changed += len(led.controller.events)
        if changed:
            break
    assert changed
