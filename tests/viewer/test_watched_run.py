"""A run of another process on the page, as its recording grows."""

import os
import threading
import time
from dataclasses import replace

import numpy as np
import pytest
from tests.runs.changed_task import DrawnCell, short, written
from tests.viewer.conftest import PATIENCE, settled

from omniservo.errors import InputError
from omniservo.recording import Recorded, RecordedRun, RunRecording, topics
from omniservo.runs import run_task
from omniservo.tasks import load_task
from omniservo.viewer.camera_view import with_trajectories
from omniservo.viewer.moment import Moment
from omniservo.viewer.open_viewed import open_viewed
from omniservo.viewer.run_on_page import RunOnPage
from omniservo.viewer.situation import with_xi
from omniservo.viewer.watched_run import recording_of


@pytest.fixture(scope="module")
def recording(tmp_path_factory):
    """Of a short run."""
    folder = tmp_path_factory.mktemp("watched")
    task = load_task(written(folder, short(5, 1.0)))
    with RunRecording(folder / "run.mcap") as recording:
        run_task(task, DrawnCell, filmed=False, recording=recording)
    return folder / "run.mcap"


def words_hold(page, words):
    """Wait until the page says so of a run."""
    end, never = time.monotonic() + PATIENCE, threading.Event()
    while words not in page.shown.job.content:
        assert time.monotonic() < end, page.shown.job.content
        never.wait(0.02)


def arm_is_followed(page):
    """Wait until a run's arm is shown; no answer need come after that."""
    end, never = time.monotonic() + PATIENCE, threading.Event()
    while page.playback.moment is None:
        assert time.monotonic() < end, page.shown.job.content
        never.wait(0.02)


@pytest.mark.slow
def test_a_recording_that_grows_is_shown_as_it_does(recording, page, tmp_path):
    whole = recording.read_bytes()
    growing = tmp_path / "result.unfinished.mcap"
    growing.write_bytes(whole[: len(whole) // 2])
    viewed = open_viewed(tmp_path / "result")
    number = page.answer.number
    page.open(viewed)
    page.wait_for(lambda answer: answer.number > number, PATIENCE)
    arm_is_followed(page)
    words_hold(page, "nothing new for")  # all that is there was read
    nodes, number = page.nodes, page.answer.number
    page.open(viewed)  # as its plan is, when that comes while the arm is followed
    page.wait_for(lambda answer: answer.number > number and page.nodes is not nodes, PATIENCE)
    assert page.playback.moment is not None
    assert "nothing is sent" in page.shown.job.content
    assert page.playback.moment.image is not None
    assert 0.0 <= page.playback.moment.time < 5.0
    with growing.open("ab") as file:
        file.write(whole[len(whole) // 2 :])
    words_hold(page, "the run has ended: the goal is reached")
    steps = [e.message for e in RecordedRun(recording) if isinstance(e, Recorded) and e.topic == topics.STEP]
    answer = page.wait_for(lambda answer: page.playback.run and page.is_settled(answer), PATIENCE)
    run = page.playback.run
    assert page.playback.moment is None
    assert np.array_equal(run.times, [step.time for step in steps])
    assert np.array_equal(run.joints, [step.joints for step in steps])
    assert run.plan.status == answer.verdict == "certified"
    camera = answer.situation.arm.scene.world_T_camera(run.joints[-1])
    assert np.linalg.norm(camera.translation - run.world_T_camera[-1].translation) < 2e-3


def test_the_camera_s_own_image_is_shown_where_the_plan_is_of_that_camera(page):
    answer, playback = settled(page), page.playback
    camera = answer.plan.problem.camera
    image = np.random.default_rng(1).integers(0, 255, (camera.height, camera.width), dtype=np.uint8)
    playback.follow(Moment(0.0, answer.joints(0.0), "", 0.25, image))
    assert playback.w == 0.25
    own = with_trajectories(image, answer.plan, 0.25)
    assert np.array_equal(playback.seen(answer), own)
    other = replace(answer, situation=answer.situation.with_problem(camera=with_xi(camera, 0.5)))
    assert not np.array_equal(playback.seen(other), own)
    playback.follow(None)


@pytest.mark.slow
def test_a_run_that_is_watched_ends_with_what_is_opened_in_its_place(recording, page, tmp_path):
    whole = recording.read_bytes()
    (tmp_path / "result.unfinished.mcap").write_bytes(whole[: len(whole) // 2])
    page.open(open_viewed(tmp_path / "result"))
    arm_is_followed(page)
    number = page.answer.number
    page.open(open_viewed("whole-arm-1"))
    settled(page, number)
    assert page.playback.moment is None
    assert page._watched.is_closed
    late = Moment(0.0, page.answer.joints(0.0), "", 0.5, None)
    RunOnPage(page, page._watched).moved(late)  # as it was being told when the other was opened
    assert page.playback.moment is None


def test_a_file_that_is_no_recording_is_refused_by_name(tmp_path):
    (tmp_path / "other.mcap").write_bytes(b"not one of ours")
    with pytest.raises(InputError, match=r"other.mcap: not an MCAP file"):
        open_viewed(tmp_path / "other.mcap")


def test_the_recording_of_a_folder_is_its_own_whatever_its_name_means_to_a_search(tmp_path):
    for name in ("run[1].unfinished.mcap", "other.unfinished.mcap"):
        (tmp_path / name).touch()
    assert recording_of(tmp_path / "run[1]").name == "run[1].unfinished.mcap"
    assert recording_of(tmp_path / "*") is None
    (tmp_path / "run[1]-ibvs.unfinished.mcap").touch()
    os.utime(tmp_path / "run[1].unfinished.mcap", (0, 0))
    assert recording_of(tmp_path / "run[1]").name == "run[1]-ibvs.unfinished.mcap"
