"""A job in the simulator, watched, and its folder on the page."""

import json
import re

import numpy as np
import pytest
from tests.viewer.conftest import settled

from omniservo.errors import InputError
from omniservo.runs import run_task
from omniservo.runs.run_inputs import RunInputs
from omniservo.tasks import load_task
from omniservo.viewer.executed_run import read_executed
from omniservo.viewer.live_servo import WatchedCell
from omniservo.viewer.open_viewed import open_viewed

RATE, TIME = 10.0, 1.2


@pytest.fixture(scope="module")
def run(tmp_path_factory):
    """The folder of a job that is cut short, and the moments that were watched."""
    folder, moments = tmp_path_factory.mktemp("run"), []
    task = load_task("whole-arm-1")
    sensor = task.sensor.model_copy(update={"rate": RATE})
    servo = task.servo.model_copy(update={"time_limit": TIME})
    short = task.model_copy(update={"sensor": sensor, "servo": servo})
    result = run_task(short, lambda job, seed: WatchedCell(job, seed, moments.append), filmed=False)
    (folder / "log.csv").write_text(result.log.to_csv())
    (folder / "metrics.json").write_text(json.dumps(result.metrics))
    result.plan.save(folder / "plan.json")
    result.goal.save(folder / "goal.json")
    RunInputs.now("certified", 0, task.sources.kept(task)).write(folder)
    return folder, moments


@pytest.mark.slow
def test_a_watched_servo_reports_arm_and_supervisor_as_time_passes(run):
    _, moments = run
    assert moments[len(moments) // 2].words == "supervisor: moving"
    assert moments[-1].words == "supervisor: stopped: time_limit"
    assert np.ptp([moment.joints for moment in moments], axis=0).max() > 1e-3
    assert (np.diff([moment.time for moment in moments]) >= 0.0).all()


def test_a_run_s_folder_is_opened_with_its_plan_and_what_was_executed(run):
    folder, _ = run
    viewed = open_viewed(folder)
    assert viewed.plan.status == "certified"
    assert viewed.run.ended.startswith("stopped: time_limit: not at the goal after 1.2 s")
    camera = viewed.situation.arm.scene.world_T_camera(viewed.run.joints[-1])
    assert np.linalg.norm(camera.translation - viewed.run.world_T_camera[-1].translation) < 2e-3
    first = viewed.run.world_T_camera[0].translation
    assert np.linalg.norm(first - viewed.situation.world_T_initial.translation) < 1e-4
    assert [viewed.run.step_at(time) for time in (-1.0, *viewed.run.times[:3])] == [0, 0, 1, 2]
    assert viewed.run.step_at(1e9) == len(viewed.run.times) - 1


@pytest.mark.slow
def test_a_run_is_played_beside_its_plan(run, page):
    number = page.answer.number
    page.open(open_viewed(run[0]))
    answer = settled(page, number)
    playback = page.playback
    playback.go_to(1.0)
    place, played = playback.place(answer), playback.run
    assert np.array_equal(place.joints, played.joints[-1])
    assert np.allclose(place.planned.as_matrix(), answer.world_T_camera(float(played.w[-1])).as_matrix())
    assert playback.followed(answer) == (played.plan, float(played.w[-1]))
    assert np.linalg.norm(place.camera.translation - place.planned.translation) < 5e-3
    playback.run_shown = False  # the box "play the run" was unticked
    assert playback.place(answer).planned is None
    playback.take_run(played)  # of the next servo
    assert playback.place(answer).planned is None
    playback.run_shown = True
    assert playback.place(answer).planned is not None


@pytest.mark.parametrize(
    ("name", "change", "message"),
    [
        ("metrics.json", lambda text: text[: len(text) // 2], "metrics.json: line 1: not JSON"),
        ("metrics.json", lambda text: "[" * 100_000, "metrics.json: nested too deeply"),
        ("log.csv", lambda text: text + "x" * 200_000, "log.csv: not the log of a run"),
        ("log.csv", lambda text: text + "1,2\n", "log.csv: not the log of a run"),
        ("log.csv", lambda text: "\n".join([text.split("\n")[0] + ",more", *text.split("\n")[1:]]),
         "log.csv: not the log of a run: .* numbers in a row, .* names"),
        ("log.csv", lambda text: text.replace("joints_5", "elbow"), "log.csv: 5 joints; the task's arm"),
        ("log.csv", lambda text: re.sub(r"\n[0-9.]+,", "\nnan,", text, count=1), "not finite"),
    ],
)  # fmt: skip
def test_a_run_s_folder_with_a_broken_file_is_refused_by_name(run, tmp_path, name, change, message):
    folder, viewed = tmp_path, open_viewed(run[0])
    for file in ("log.csv", "metrics.json"):
        (folder / file).write_text((run[0] / file).read_text())
    scene = viewed.situation.arm.scene
    assert len(read_executed(folder, scene, None).times) == len(viewed.run.times)
    (folder / name).write_text(change((folder / name).read_text()))
    with pytest.raises(InputError, match=message):
        read_executed(folder, scene, None)


def test_a_run_that_was_stopped_before_a_step_has_no_motion(run, tmp_path):
    header = (run[0] / "log.csv").read_text().split("\n")[0]
    for text in ("", header, header + "\n\n"):
        (tmp_path / "log.csv").write_text(text)
        assert read_executed(tmp_path, open_viewed(run[0]).situation.arm.scene, None) is None
