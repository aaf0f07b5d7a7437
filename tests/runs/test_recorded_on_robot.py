"""`run --on` over RTDE and MJPEG: its recording, read by others, replayed, and however the run ends."""

import dataclasses
import json
import os
import shutil
import subprocess
import sys
import time
from contextlib import contextmanager
from pathlib import Path

import pytest
from tests.runs.changed_task import PlainCell, shipped, short, written
from tests.runs.test_recordings import changed, messages, with_asked, with_message

from omniservo.cli.main import main
from omniservo.errors import InputError, NoSolutionError
from omniservo.recording import Attachment, QueuedRecording, Recorded, RecordedRun, topics
from omniservo.runs import open_hardware, recording_beside, replay_run, run_task, teach_goal
from omniservo.runs.robot_records import save_check
from omniservo.runs.safety_of_task import safety_of_task
from omniservo.tasks import load_robot, load_task

pytestmark = pytest.mark.slow  # each needs a whole run


def patient(task):
    """For machines that do much besides; that the limits hold is shown in simulated time."""
    limits = {"joint_age": 1.0, "reaction": 1.0, "image_age": 2.0, "following_error": 1.0}
    return dataclasses.replace(safety_of_task(task), **limits)


@pytest.fixture(scope="module")
def job(tmp_path_factory):
    """A folder with a task and its goal."""
    folder = tmp_path_factory.mktemp("robot")
    task = load_task(written(folder, short(5, 2.5)))
    cell = PlainCell(task, 1)
    teach_goal(task, cell).save(folder / "goal.json")
    cell.close()
    return folder


@contextmanager
def served(job):
    """The folder, with the checked file of a robot that stands at the task's start."""
    (job / "robot.yaml").unlink(missing_ok=True)
    serving = subprocess.Popen(
        [sys.executable, "-m", "omniservo.cli.main", "sim", "serve", str(job / "task.yaml"),
         "--free-ports", "--projected", "--robot-file", str(job / "robot.yaml")],
        env=os.environ, stdout=subprocess.DEVNULL,
    )  # fmt: skip
    try:
        end = time.monotonic() + 120.0
        while not (job / "robot.yaml").exists():
            assert serving.poll() is None
            assert time.monotonic() < end
            time.sleep(0.1)
        save_check(job / "robot.yaml", load_robot(job / "robot.yaml"))
        yield job
    finally:
        serving.terminate()  # a test in the background, and what it starts, hears no Ctrl-C
        serving.wait()


def run_on(there, out, *more):
    """Run it by command; return the exit code."""
    arguments = ["run", there / "task.yaml", "--on", there / "robot.yaml", "--goal", there / "goal.json"]
    with pytest.MonkeyPatch.context() as patch, pytest.raises(SystemExit) as end:
        patch.setattr(open_hardware, "safety_of_task", patient)
        patch.setattr(open_hardware, "PERIODS", 10.0)
        main([str(each) for each in [*arguments, "--yes", "--no-film", "--out", out, *more]])
    return end.value.code


@pytest.fixture(scope="module")
def recording(job):
    """Of one run, whatever it came to on a busy machine, which may end it before it has begun."""
    for number in range(5):
        result = job / f"result-{number}"
        with served(job) as folder:
            run_on(folder, result, "--speed", "0.5")  # at a tenth of the speed it takes five times as long
            if result.exists():
                shutil.copy(job / "robot.yaml", result / "robot.yaml")
        if result.exists() and len(messages(result / "recording.mcap", topics.STEP)) > 5:
            return result / "recording.mcap"
    raise AssertionError("no run had more than five steps")


def test_a_replay_is_equal_bit_by_bit(recording):
    found = replay_run(recording)
    assert found.differences == ()
    assert found.largest == 0.0
    assert found.steps == len(messages(recording, topics.STEP)) > 3
    assert (found.cut, found.dropped, found.left) == (False, 0, 0)


def test_its_timeline_is_the_run_and_does_not_begin_at_the_zero_of_the_clock(recording):
    times = [e.time for e in RecordedRun(recording) if hasattr(e, "topic")]
    first = min(m.header.stamp.seconds for m in messages(recording, topics.IMAGE))
    assert times[0] > first - 60.0 > 0.0


def test_everything_that_passed_is_in_it(recording):
    entries = list(RecordedRun(recording))
    names = {e.name for e in entries if isinstance(e, Attachment)}
    assert names == {
        "files/task.yaml", "robot/robot.yaml", "run.json", "goal.json", "estimate.json", "plan.json",
        "safety.json", "metrics.json",
    }  # fmt: skip
    (robot,) = [e.data for e in entries if getattr(e, "name", "") == "robot/robot.yaml"]
    assert robot == (recording.parent / "robot.yaml").read_bytes()
    steps = messages(recording, topics.STEP)
    stamps = [m.header.stamp.seconds for m in messages(recording, topics.IMAGE)]
    assert stamps == sorted(set(stamps))
    assert {s.header.stamp.seconds for s in steps} <= set(stamps)
    read = [m.header.stamp.seconds for m in messages(recording, topics.JOINT_STATES)]
    assert read == sorted(set(read))
    assert len([t for t in read if steps[0].state_time <= t]) > 10 * len(steps)
    commands = messages(recording, topics.JOINT_COMMANDS)
    assert any(m.velocity.any() for m in commands)
    sent = [m.header.stamp.seconds for m in commands]
    assert sent == sorted(sent)
    assert not set(sent) & set(read)  # each has the time at which it was sent
    assert len(messages(recording, topics.PLANNED_PATH)) == 1
    assert len(messages(recording, topics.END)) == 1
    metrics = json.loads((recording.parent / "metrics.json").read_text())
    assert metrics["recorded_images"] == len(stamps)
    assert metrics["recorded_images_dropped"] == 0
    assert "Images in the recording" in (recording.parent / "report.html").read_text()


def test_two_other_readers_read_all_of_it(recording):
    reader = pytest.importorskip("mcap.reader", reason="reads MCAP independently")
    decoder = pytest.importorskip("mcap_ros2.decoder", reason="reads ROS 2's messages independently")
    highlevel = pytest.importorskip("rosbags.highlevel", reason="reads bags independently")
    ours = [e for e in RecordedRun(recording) if isinstance(e, Recorded)]
    with recording.open("rb") as stream:
        found = reader.make_reader(stream, decoder_factories=[decoder.DecoderFactory()], validate_crcs=True)
        theirs = [(c.topic, m) for _, c, _, m in found.iter_decoded_messages(log_time_order=False)]
    with highlevel.AnyReader([recording]) as bag:
        bags = [(c.topic, bag.deserialize(raw, c.msgtype)) for c, _, raw in bag.messages()]
    for topic in {entry.topic for entry in ours}:
        wanted = [entry.message for entry in ours if entry.topic == topic]
        for other in (theirs, bags):
            assert len([m for t, m in other if t == topic]) == len(wanted)
    for other in (theirs, bags):
        sent = [list(m.velocity) for t, m in other if t == topics.JOINT_COMMANDS]
        assert sent == [list(m.velocity) for m in messages(recording, topics.JOINT_COMMANDS)]


def without(topic, number):
    """A change that leaves out one message of a topic."""
    seen = [-1]

    def change(entry):
        seen[0] += isinstance(entry, Recorded) and entry.topic == topic
        is_it = isinstance(entry, Recorded) and entry.topic == topic and seen[0] == number
        return None if is_it else entry

    return change


def test_an_image_that_is_missing_is_said_unless_the_file_says_it(recording, tmp_path):
    steps = len(messages(recording, topics.STEP))
    stamp = messages(recording, topics.STEP)[3].header.stamp.seconds
    number = [m.header.stamp.seconds for m in messages(recording, topics.IMAGE)].index(stamp)
    found = replay_run(changed(recording, tmp_path / "c.mcap", without(topics.IMAGE, number)))
    (words,) = found.differences
    assert words == f"images: that of {stamp:.6f} s is missing, which the file does not say"
    with QueuedRecording(tmp_path / "d.mcap") as copy:
        for entry in RecordedRun(tmp_path / "c.mcap"):
            if isinstance(entry, Attachment):
                copy.attach(entry.name, "", entry.data)
            elif isinstance(entry, Recorded):
                copy.write(entry.topic, entry.message, entry.time)
        copy.note_dropped(1)
    found = replay_run(tmp_path / "d.mcap")
    assert (found.differences, found.steps, found.dropped, found.left) == ((), 3, 1, steps - 3)


REFUSED = {
    "a command that is missing": (without(topics.JOINT_COMMANDS, 7), "/joint_commands: one is missing"),
    "joints that are missing": (without(topics.JOINT_STATES, 30), "/joint_states: that of .* s is missing"),
    "a call that is none": (with_message(topics.CALLS, 2, calls=lambda c: c + 100), r"calls: \d+ given"),
    "a number of a call": (with_message(topics.CALLS, 2, values=lambda v: v[:-1]), "these calls have"),
    "a time that is none": (with_message(topics.CALLS, 2, values=lambda v: v * float("nan")), "values: nan"),
    "a robot elsewhere": (with_asked(robot={"file": "../../r.yaml", "speed": 1.0}), "files kept with it"),
    "a speed": (with_asked(robot={"file": "robot.yaml", "speed": 7.0}), "robot: speed: 7"),
    "no robot": (with_asked(robot="x"), "robot: 'x' given"),
    "no joints": (with_asked(start_joints=None), "start_joints: 0 numbers given; rx60 has 6"),
}


@pytest.mark.parametrize("name", REFUSED)
def test_what_is_not_legal_is_refused_by_name(recording, tmp_path, name):
    change, words = REFUSED[name]
    file = changed(recording, tmp_path / "c.mcap", change)
    with pytest.raises(InputError, match=words) as told:
        replay_run(file)
    assert str(file) in str(told.value)


def interrupted_at(count):
    """A recorder's step that is Ctrl-C the so-manieth time."""
    from omniservo.runs.recorder import Recorder

    steps, step = [], Recorder.step

    def interrupted(self, each):
        step(self, each)
        steps.append(each)
        if len(steps) == count:
            raise KeyboardInterrupt

    return interrupted


def test_a_servo_that_is_broken_off_is_recorded_and_replayed_up_to_there(tmp_path, monkeypatch):
    from omniservo.runs.recorder import Recorder

    monkeypatch.setattr(Recorder, "step", interrupted_at(7))
    left = []
    task = load_task("paper-example-1")
    with pytest.raises(KeyboardInterrupt), recording_beside(tmp_path / "r", tmp_path, left.append) as file:
        run_task(task, PlainCell, filmed=False, recording=file)
    monkeypatch.undo()
    assert left == [tmp_path / "r.mcap"]
    found = replay_run(left[0])
    assert (found.differences, found.ended, found.steps, found.cut) == ((), "broken_off", 7, False)


def test_a_run_goes_on_whose_disk_is_full(tmp_path):
    if not os.path.exists("/dev/full"):
        pytest.skip("no /dev/full")
    document = shipped("paper-example-1")
    document["servo"] = document.get("servo", {}) | {"time_limit": 0.5}
    task = load_task(written(tmp_path, document))
    (tmp_path / "r.unfinished.mcap").symlink_to("/dev/full")
    with QueuedRecording(tmp_path / "r.mcap") as recording:
        result = run_task(task, PlainCell, filmed=False, recording=recording)
    assert len(result.log.rows) > 5
    (notice,) = [n for n in result.metrics["notices"] if "recording" in n]
    assert notice.endswith("r.unfinished.mcap: No space left on device")


def test_a_recording_moves_into_the_folder_or_stays_beside_it(tmp_path):
    left, work = [], tmp_path / "work"
    work.mkdir()
    with recording_beside(tmp_path / "a", work, left.append) as recording:
        assert Path(recording.unfinished).name == "a.unfinished.mcap"
    assert [p.name for p in work.iterdir()] == ["recording.mcap"]
    with pytest.raises(KeyboardInterrupt), recording_beside(tmp_path / "a", work, left.append) as recording:
        recording.parameters({"task": "none"})
        raise KeyboardInterrupt
    (tmp_path / "a-2.unfinished.mcap").touch()
    with (
        pytest.raises(InputError, match="no"),
        recording_beside(tmp_path / "a", work, left.append) as recording,
    ):
        recording.parameters({"task": "none"})
        raise InputError("no")
    assert [p.name for p in left] == ["a.mcap", "a-3.mcap"]


def test_a_run_that_is_refused_before_anything_is_recorded_leaves_no_recording(tmp_path):
    left = []
    with pytest.raises(InputError, match="no"), recording_beside(tmp_path / "a", tmp_path, left.append):
        raise InputError("no")
    assert (left, list(tmp_path.iterdir())) == ([], [])


@pytest.fixture(scope="module")
def there(job):
    """Served for those runs that end before the arm moves; they stand last, as it is served to the end."""
    with served(job) as folder:
        yield folder


def test_an_interrupted_run_leaves_its_recording_beside_the_folder(there, tmp_path, monkeypatch, capsys):
    from omniservo.cli.robot_file import Approval

    def interrupted(self, motion):
        raise KeyboardInterrupt

    monkeypatch.setattr(Approval, "__call__", interrupted)
    (tmp_path / "out.mcap").write_bytes(b"another run's")
    assert run_on(there, tmp_path / "out") == 130
    assert sorted(p.name for p in tmp_path.iterdir()) == ["out-2.mcap", "out.mcap"]
    assert "out-2.mcap" in capsys.readouterr().out
    found = replay_run(tmp_path / "out-2.mcap")
    assert (found.differences, found.ended, found.steps, found.cut) == ((), "broken_off", 0, False)


def test_a_run_that_was_not_agreed_to_is_replayed_without_a_difference(there, tmp_path, monkeypatch):
    from omniservo.cli.robot_file import Approval

    def declined(self, motion):
        raise NoSolutionError("the motion was not agreed to, and not made")

    monkeypatch.setattr(Approval, "__call__", declined)
    assert run_on(there, tmp_path / "out") == 1
    found = replay_run(tmp_path / "out.mcap")
    assert (found.differences, found.ended, found.steps) == ((), "broken_off", 0)


def test_a_killed_run_leaves_a_file_that_is_read_and_replayed_to_its_end(there, tmp_path):
    running = subprocess.Popen(
        [sys.executable, "-m", "omniservo.cli.main", "run", str(there / "task.yaml"), "--on",
         str(there / "robot.yaml"), "--goal", str(there / "goal.json"), "--yes", "--out",
         str(tmp_path / "o")],
        env=os.environ, stdout=subprocess.DEVNULL,
    )  # fmt: skip
    file, end = tmp_path / "o.unfinished.mcap", time.monotonic() + 240.0
    while not (file.exists() and any(getattr(e, "topic", "") == topics.MATCH for e in RecordedRun(file))):
        assert time.monotonic() < end
        assert running.poll() is None
        time.sleep(0.2)
    running.kill()
    running.wait()
    found = replay_run(file)
    assert (found.cut, found.differences) == (True, ())
