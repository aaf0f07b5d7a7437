"""A target that is pushed along the line of sight takes no run of a task off its path into an obstacle."""

import sys
from dataclasses import replace

import numpy as np
import pytest
from tests.runs.changed_task import DrawingRobot, DrawnCell, UnfilmedTruth, shipped, written
from tests.runs.test_tube_of_task import folder, task_with  # noqa: F401

from omniservo.recording import RunRecording
from omniservo.runs import replay_run, run_task
from omniservo.runs.safety_of_task import path_room_of, safety_of_task
from omniservo.runs.task_gaps import TaskGaps
from omniservo.simulation.projected_dots import ProjectedDots
from omniservo.tasks import load_task

PUSH, BEGIN, TAKES = np.array([0.0, 0.0, 0.09]), 0.3, 2.0
"""[m] along the line of sight of the initial camera, from when on [s], and in how long [s]"""


class PushedTarget(DrawingRobot):
    """The target is pushed away while the arm moves."""

    _shown = BEGIN
    """[s] when the image was exposed in which it was pushed last"""

    def image(self):
        exposure, scene = self.newest_exposure(), self.world.scene
        if exposure is not None and exposure.time > self._shown:
            self._shown = exposure.time
            share = min((exposure.time - BEGIN) / TAKES, 1.0)
            by = scene.world_T_camera(scene.start_joints).rotation.apply(share * PUSH)
            self._dots = ProjectedDots(
                replace(scene, dots=replace(scene.dots, centers=scene.dots.centers + by))
            )
        return super().image()


class PushedCell(DrawnCell):
    """The goal is taught before, in a cell of its own, which has another seed."""

    def __init__(self, task, seed=0):
        super().__init__(task, seed)
        if seed == 0:
            self.robot = PushedTarget(self.robot.world.scene)
            self.truth = UnfilmedTruth(self.robot)


def pushed(recording=None):
    task = load_task("whole-arm-2")
    sensor = task.sensor.model_copy(update={"rate": 10.0})  # images take most of the time
    task = task.model_copy(update={"sensor": sensor})
    return run_task(task, PushedCell, filmed=False, recording=recording)


def test_a_target_that_is_pushed_along_the_line_of_sight_stops_the_run_by_name_before_anything_is_touched():
    result = pushed()
    metrics = result.metrics
    assert (metrics["status"], result.log.stop_reason, metrics["contacts"]) == ("stopped", "off_path", [])
    assert "the path keeps 8 mm free" in metrics["reason"]
    assert metrics["arm_clearance_executed_m"] > 0.0


@pytest.fixture
def roomless(monkeypatch):
    """The camera may be anywhere beside its path."""
    for module in ("run_task", "replay_run"):
        monkeypatch.setattr(
            sys.modules[f"omniservo.runs.{module}"],
            "safety_of_task",
            lambda task: replace(safety_of_task(task), path_room=None),
        )


@pytest.mark.slow
def test_without_the_room_the_gaps_of_all_bodies_stop_the_same_run_before_anything_is_touched(
    roomless, tmp_path, monkeypatch
):
    with RunRecording(tmp_path / "run.mcap") as recording:
        result = pushed(recording)
    metrics = result.metrics
    assert (metrics["status"], result.log.stop_reason, metrics["contacts"]) == ("stopped", "too_near", [])
    assert "at least 2.5 mm are kept" in metrics["reason"]
    assert metrics["arm_clearance_executed_m"] >= 0.0025
    replay = replay_run(tmp_path / "run.mcap")
    assert (replay.ended, replay.differences) == ("too_near", ())
    monkeypatch.setattr(TaskGaps, "check", lambda *_: None)  # as a program that looks at no gaps
    replay = replay_run(tmp_path / "run.mcap")
    assert replay.differences == ("end: too_near recorded; replayed: nothing stops it",)


@pytest.mark.slow
def test_without_room_and_gaps_the_same_push_ends_in_a_contact(roomless, monkeypatch):
    monkeypatch.setattr(TaskGaps, "check", lambda *_: None)
    assert pushed().metrics["contacts"]


def changed(tmp_path, planning, **parts):
    document = shipped("whole-arm-1") | parts
    document["planning"] |= planning
    return load_task(written(tmp_path, document))


def test_the_room_is_that_of_tracking_and_what_the_bodies_keep():
    assert path_room_of(load_task("whole-arm-1")) == pytest.approx(0.003 + 0.005)
    assert path_room_of(load_task("moving-panel")) == pytest.approx(0.006 + 0.005)


def test_the_cameras_own_clearance_is_no_room():
    task = load_task("paper-example-1")
    assert (task.planning.arm_clearance, task.planning.clearance) == (None, 0.055)
    assert path_room_of(task) == task.planning.tracking_margin == 0.01


def test_of_a_tracking_tube_the_room_is_its_position(folder):  # noqa: F811
    assert path_room_of(task_with(folder)) == pytest.approx(0.003 + 0.005, rel=0.01)


def test_where_nothing_stands_around_or_nothing_is_kept_the_camera_is_not_watched(tmp_path):
    none = {"obstacles": []}
    wall = [{"center": [0, 0, 900], "half_extents": [500, 500, 10]}]
    assert path_room_of(changed(tmp_path, none, obstacles=[])) is None
    assert path_room_of(changed(tmp_path, none, obstacles=[], surroundings=wall)) == pytest.approx(0.008)
    assert path_room_of(changed(tmp_path, {"tracking_margin": 0, "arm_clearance": None})) is None
    assert path_room_of(changed(tmp_path, {"tracking_margin": 0})) == 0.005
