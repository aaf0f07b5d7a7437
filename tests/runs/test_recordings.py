"""Recordings of whole runs: exported, replayed to the last bit, and told when changed."""

import dataclasses
import json
import os
import resource
import subprocess
import sys
from functools import cache

import jsonschema
import numpy as np
import pytest
from tests.cli.valid_output import check_output
from tests.runs.changed_task import DrawnCell, short, written
from tests.runs.test_looks import task_with

from omniservo.cli.main import main
from omniservo.errors import InputError, NoSolutionError, NotWritten
from omniservo.files import noting_reads
from omniservo.recording import Attachment, Parameters, Recorded, RecordedRun, RunRecording, topics
from omniservo.recording.recorded_messages import LogMessage, MatchMessage
from omniservo.runs import export_run, recorded_job, replay_run, run_into, run_task
from omniservo.runs.comparison import Comparison
from omniservo.schemas import json_schema
from omniservo.tasks import load_task

pytestmark = pytest.mark.slow  # each needs a whole run


@pytest.fixture(scope="module")
def run(tmp_path_factory):
    """The folder of a short run, its task in another folder that is gone by then."""
    folder = tmp_path_factory.mktemp("run")
    task = written(folder, short(8, 2.0))
    (folder / "r").mkdir()
    run_into(folder / "r", load_task(task), DrawnCell, seed=5, filmed=False)
    task.unlink()
    return folder / "r"


@pytest.fixture(scope="module")
def recording(run):
    file = run.parent / "run.mcap"
    assert export_run(run, file, DrawnCell).repeated
    return file


def entries_of(recording):
    """Its entries, read once: tests ask for those of the same file again and again."""
    return _entries(recording, recording.stat().st_mtime_ns)


@cache
def _entries(recording, written_at):
    return tuple(RecordedRun(recording))


def changed(recording, out, change):
    """Write the recording anew, with ``change(entry)`` in the place of each entry; None leaves it out."""
    with RunRecording(out, force=True) as copy:
        for entry in entries_of(recording):
            entry = change(entry)
            if isinstance(entry, Attachment):
                copy.attach(entry.name, "", entry.data)
            elif isinstance(entry, Parameters):
                copy.parameters({k: v for k, v in entry.values.items() if k != "format"})
            elif entry is not None:
                copy.write(entry.topic, entry.message, entry.time)
    return out


def messages(recording, topic):
    return [e.message for e in entries_of(recording) if isinstance(e, Recorded) and e.topic == topic]


def with_message(topic, number, **fields):
    """A change of the fields of one message of a topic; a function is called with what was there."""
    seen = [0]

    def change(entry):
        if not isinstance(entry, Recorded) or entry.topic != topic:
            return entry
        seen[0] += 1
        if seen[0] - 1 != number:
            return entry
        values = {
            name: value(getattr(entry.message, name)) if callable(value) else value
            for name, value in fields.items()
        }
        return dataclasses.replace(entry, message=dataclasses.replace(entry.message, **values))

    return change


def with_asked(**fields):
    """A change of run.json."""

    def change(entry):
        if isinstance(entry, Attachment) and entry.name == "run.json":
            return Attachment(entry.name, json.dumps(json.loads(entry.data) | fields).encode())
        return entry

    return change


def nudged(place, by):
    def change(array):
        array = np.array(array)
        array[place] += by
        return array

    return change


def test_a_replay_is_equal_bit_by_bit(recording):
    found = replay_run(recording)
    assert found.differences == ()
    assert found.largest == 0.0
    assert found.steps == len(messages(recording, topics.STEP)) > 15
    assert (found.cut, found.ended, found.task) == (False, "", "paper-example-1")


def test_a_recording_holds_every_image_of_the_servo_and_what_was_made_of_it(recording, run):
    images = {m.header.stamp.seconds: m for m in messages(recording, topics.IMAGE)}
    steps = messages(recording, topics.STEP)
    assert {s.header.stamp.seconds for s in steps} <= set(images)
    times = [m.header.stamp.seconds for m in messages(recording, topics.JOINT_STATES)]
    assert times == sorted(set(times))
    moving = [t for t in times if steps[0].state_time <= t <= steps[-1].state_time]
    assert max(np.diff(moving)) < 6e-3  # as often as the arm is watched
    (path,) = messages(recording, topics.PLANNED_PATH)
    assert [path.poses[0].pose.position.x, path.poses[0].pose.position.y] == pytest.approx([0, 0], abs=1e-9)
    goal = json.loads((run / "plan.json").read_text())["problem"]["goal"]["translation"]
    end = path.poses[-1].pose.position
    assert [end.x, end.y, end.z] == pytest.approx(goal, abs=1e-8)
    attached = {e.name: e.data for e in RecordedRun(recording) if isinstance(e, Attachment)}
    for name in ("run", "goal", "estimate", "plan"):
        jsonschema.validate(json.loads(attached[f"{name}.json"]), json_schema(name))
    assert set(attached) == {
        "files/task.yaml", "run.json", "goal.json", "estimate.json", "plan.json", "safety.json",
        "metrics.json",
    }  # fmt: skip
    (end,) = messages(recording, topics.END)
    assert end.reason == ""
    frames = {t.child_frame_id for m in messages(recording, topics.FRAMES) for t in m.transforms}
    assert frames == {"camera", "camera_estimated"}


def test_recording_changes_nothing_of_a_run(run, recording):
    """The export itself compares the logs; here the figures that are no times."""
    kept = json.loads((run / "metrics.json").read_text())
    (now,) = [json.loads(e.data) for e in RecordedRun(recording) if getattr(e, "name", "") == "metrics.json"]
    assert {k: v for k, v in kept.items() if "seconds" not in k} == {
        k: v for k, v in now.items() if "seconds" not in k
    }


STEP = topics.STEP
CHANGES = [
    (with_message(STEP, 6, pixels=nudged(3, 0.01)), "points [px]: step 7"),
    (with_message(STEP, 7, valid=lambda v: np.where(np.arange(len(v)) == 3, 0, v)), "points found: step 8"),
    (with_message(STEP, 0, twist=nudged(5, 1e-5)), "camera twist: step 1"),
    (with_message(STEP, 3, estimated_pose=nudged(6, -2e-6)), "estimated pose: step 4"),
    (with_message(STEP, 4, reference_pixels=nudged(0, 1.0)), "reference [px]: step 5"),
    (with_message(STEP, 5, w=0.99), "path parameter w: step 6"),
    (with_message(STEP, 8, filter_change=nudged(0, 1.0)), "visibility filter's change: step 9"),
    (with_message(STEP, 9, leg=1), "way followed: step 10"),
    (with_message(STEP, 10, error_px=7.0), "distance to the reference [px]: step 11"),
    (with_message(STEP, 11, goal_error_px=7.0), "distance to the goal image [px]: step 12"),
    (with_message(STEP, 12, time=7.0), "time [s]: step 13"),
    (with_message(topics.MATCH, 0, initial=nudged(0, 0.1)), "matched points, initial image: "),
    (with_message(topics.MATCH, 0, goal=nudged(0, 0.1)), "matched points, goal image: "),
    (with_message(topics.END, 0, reason="workspace"), "end: workspace recorded"),
]
"""Each is told, once, where it is."""


def test_what_was_changed_in_the_log_is_told_where_it_was(recording, tmp_path):
    def change(entry):
        for each, _ in CHANGES:
            entry = each(entry)
        return entry

    told = replay_run(changed(recording, tmp_path / "c.mcap", change)).differences
    for _, words in CHANGES:
        assert sum(each.startswith(words) for each in told) == 1, words
    assert len(told) == len(CHANGES)
    assert not any("more)" in each for each in told)


@pytest.mark.parametrize(
    ("change", "words"),
    [
        (with_message(topics.IMAGE, 9, data=lambda d: np.where(np.arange(len(d)) % 2, d, 0)), ""),
        (with_asked(method="paper"), "plan."),
    ],
)
def test_other_inputs_come_to_something_else(recording, tmp_path, change, words):
    found = replay_run(changed(recording, tmp_path / "c.mcap", change))
    assert any(each.startswith(words) for each in found.differences), found.differences


def test_a_plan_that_was_changed_is_told(recording, tmp_path):
    def change(entry):
        if isinstance(entry, Attachment) and entry.name == "plan.json":
            plan = json.loads(entry.data)
            plan["path"]["translation"][0][0] += 1e-4
            return Attachment(entry.name, json.dumps(plan).encode())
        return entry

    (words,) = replay_run(changed(recording, tmp_path / "c.mcap", change)).differences
    assert words.startswith("plan.path.translation")


def test_steps_that_are_missing_at_the_end_are_told(recording, tmp_path):
    steps = len(messages(recording, STEP))
    seen = []

    def change(entry):
        seen.append(isinstance(entry, Recorded) and entry.topic == STEP)
        return None if seen[-1] and sum(seen) == steps else entry

    (words,) = replay_run(changed(recording, tmp_path / "c.mcap", change)).differences
    assert words == "end: the goal was reached as recorded; replayed: it is not yet"


def test_a_cut_recording_is_replayed_up_to_the_cut(recording, tmp_path):
    data = recording.read_bytes()
    part = tmp_path / "part.mcap"
    part.write_bytes(data[: len(data) // 2])
    found = replay_run(part)
    assert (found.cut, found.ended, found.differences) == (True, "cut", ())
    assert 3 < found.steps < len(messages(recording, STEP)) - 3
    part.write_bytes(data[:3000])
    with pytest.raises(InputError, match=r"no run\.json: it is cut off before it"):
        replay_run(part)


REFUSED = {
    "no number for joints": (
        with_message(STEP, 4, joints=nudged(0, np.nan)),
        r"/joint_states: position: nan at index",
    ),
    "no number for a time": (with_message(STEP, 4, image_time=np.nan), "image_time: nan"),
    "no number for a reading": (
        with_message(topics.JOINT_STATES, 500, velocity=nudged(1, np.inf)),
        "/joint_states: velocity: inf",
    ),
    "a time before the last": (with_message(STEP, 4, image_time=-5.0), "image_time -5 s after"),
    "colours": (with_message(topics.IMAGE, 3, encoding="rgb8"), "legal: 'mono8'"),
    "an image that is too short": (with_message(topics.IMAGE, 3, height=900), "legal: 900 ×"),
    "an image of another size": (
        with_message(topics.IMAGE, 0, height=659, width=432, step=432),
        "an image of 432 × 659 px; the camera has 659 × 432 px",
    ),
    "another format": (with_asked(format="omniservo.run/9"), "legal: 'omniservo.run/1'"),
    "a method": (with_asked(method="os.system"), "legal: certified, certified-once, paper, ibvs"),
    "a seed": (with_asked(seed=-1), "seed: -1"),
    "a task elsewhere": (with_asked(task="../../etc/passwd"), "legal: one of the files kept with it"),
    "a package elsewhere": (with_asked(packages={"a": "../b"}), "legal: one that stays inside"),
    "joints of another arm": (with_asked(start_joints=[0.0] * 7), "7 numbers given; rx60 has 6"),
    "joints that are no numbers": (with_asked(start_joints=["a"]), "start_joints"),
}


@pytest.mark.parametrize("name", REFUSED)
def test_what_is_not_legal_is_refused_by_name(recording, tmp_path, name):
    change, words = REFUSED[name]
    file = changed(recording, tmp_path / "c.mcap", change)
    with pytest.raises(InputError, match=words) as told:
        replay_run(file)
    assert str(file) in str(told.value)


@pytest.mark.parametrize("path", ["../outside.txt", "/outside.txt", "a/../../outside.txt", "a\\..\\b"])
def test_no_file_of_a_recording_is_written_outside(recording, tmp_path, path):
    with RunRecording(tmp_path / "d.mcap") as copy:
        copy.attach(f"files/{path}", "", b"x")
        for entry in RecordedRun(recording):
            if isinstance(entry, Attachment):
                copy.attach(entry.name, "", entry.data)
    with pytest.raises(InputError, match="legal: one that stays inside"):
        replay_run(tmp_path / "d.mcap")


def test_a_task_in_a_recording_reads_no_file_of_its_reader(recording, tmp_path):
    secret = tmp_path / "secret.yaml"
    secret.write_text("fx: 1")

    def change(entry):
        if isinstance(entry, Attachment) and entry.name.startswith("files/"):
            task = json.loads(entry.data) | {"simulation": {"true_camera": str(secret)}}
            return Attachment(entry.name, json.dumps(task).encode())
        return entry

    file = changed(recording, tmp_path / "c.mcap", change)
    with noting_reads() as read, pytest.raises(InputError, match=r"simulation\.true_camera"):
        replay_run(file)
    assert secret not in read


@pytest.mark.parametrize("given", ["omniservo.recording/2", "other"])
def test_a_recording_of_another_format_is_refused_with_the_version_that_wrote_it(tmp_path, given):
    with RunRecording(tmp_path / "newer.mcap") as newer:
        newer.parameters({"format": given, "version": "9.1.0"})
        newer.attach("run.json", "application/json", b"{}")
    with pytest.raises(InputError, match=r"newer\.mcap: format: '" + given + "' given; .* version '9.1.0'"):
        replay_run(tmp_path / "newer.mcap")


def test_a_recording_that_is_not_ours_is_refused(tmp_path):
    with RunRecording(tmp_path / "other.mcap") as other:
        other.attach("notes.txt", "text/plain", b"hello")
    with pytest.raises(InputError, match="not a run that was recorded by omniservo"):
        replay_run(tmp_path / "other.mcap")


def test_a_run_that_does_not_come_out_the_same_is_not_exported(run, tmp_path):
    log = run / "log.csv"
    kept = log.read_text()
    head, first, *rest = kept.splitlines()
    values = first.split(",")
    values[head.split(",").index("twist_2")] = "0.5"
    try:
        log.write_text("\n".join([head, ",".join(values), *rest]) + "\n")
        with pytest.raises(NoSolutionError, match=r"another run: twist_2: step 1: 0\.5 recorded"):
            export_run(run, tmp_path / "e.mcap", DrawnCell)
    finally:
        log.write_text(kept)
    assert list(tmp_path.iterdir()) == []


def test_the_recording_of_a_run_that_has_one_is_that_one(recording, tmp_path):
    (tmp_path / "r").mkdir()
    (tmp_path / "r" / "recording.mcap").write_bytes(recording.read_bytes())
    made = export_run(tmp_path / "r", tmp_path / "out.mcap", DrawnCell)
    assert not made.repeated
    assert (tmp_path / "out.mcap").read_bytes() == recording.read_bytes()


def test_a_recording_that_does_not_fit_on_the_disk_leaves_what_was_there(tmp_path):
    run, out = tmp_path / "r", tmp_path / "out.mcap"
    run.mkdir()
    with RunRecording(run / "recording.mcap") as recording:
        recording.attach("notes", "text/plain", os.urandom(200_000))
    out.write_bytes(b"of before")
    before = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (50_000, before[1]))
    try:
        with pytest.raises(NotWritten, match=r"out\.mcap"):
            export_run(run, out, DrawnCell, force=True)
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, before)
    assert out.read_bytes() == b"of before"
    assert sorted(tmp_path.iterdir()) == [out, run]


def test_a_run_that_looks_again_and_is_stopped_is_replayed(tmp_path):
    task = task_with(tmp_path)
    task = task.model_copy(update={"servo": task.servo.model_copy(update={"time_limit": 1.5})})
    document = json.loads((tmp_path / "task.yaml").read_text())
    document["servo"] = document.get("servo", {}) | {"time_limit": 1.5}
    with RunRecording(tmp_path / "looks.mcap") as recording:
        result = run_task(
            load_task(written(tmp_path, document)), DrawnCell, filmed=False, recording=recording
        )
    assert len(result.looks) == 1
    found = replay_run(tmp_path / "looks.mcap")
    assert found.differences == ()
    assert found.ended == "time_limit"
    assert found.steps == len(result.log.rows)


def test_a_refusal_is_replayed_as_one(tmp_path):
    task = task_with(tmp_path, looks=0)
    with RunRecording(tmp_path / "no.mcap") as recording, pytest.raises(NoSolutionError):
        run_task(task, DrawnCell, filmed=False, recording=recording)
    found = replay_run(tmp_path / "no.mcap")
    assert (found.differences, found.ended, found.steps) == ((), "refused", 0)


def test_numbers_within_the_tolerance_are_equal_but_not_bit_by_bit():
    found = Comparison()
    found.numbers("a", "", [1.0, np.nan], [1.0 + 5e-7, np.nan])
    assert found.differences == ()
    assert found.largest == pytest.approx(5e-7)
    found.numbers("a", "step 1: ", [1.0], [np.nan])
    found.numbers("a", "step 2: ", [1.0], [2.0])
    assert found.differences == ("a: step 1: 1 recorded, nan replayed (and 1 more)",)


def told(arguments, capsys):
    with pytest.raises(SystemExit) as end:
        main([str(each) for each in arguments])
    said = capsys.readouterr()
    if "--json" in arguments:
        check_output(said.out)
    return end.value.code, said


def test_the_command_says_equal_or_what_differs(recording, tmp_path, capsys):
    code, out = told(["run", "--replay", recording, "--json"], capsys)
    answer = json.loads(out.out)
    assert (code, answer["status"], answer["differences"]) == (0, "equal", [])
    file = changed(recording, tmp_path / "c.mcap", with_message(STEP, 6, pixels=nudged(3, 0.01)))
    code, out = told(["run", "--replay", file], capsys)
    assert code == 1
    assert "points [px]: step 7" in out.err
    code, out = told(["run", "--replay", recording, "--seed", "3"], capsys)
    assert code == 2
    assert "--seed: given with --replay" in out.err
    code, out = told(["run", "--replay", tmp_path / "none.mcap"], capsys)
    assert code == 2
    assert "no such file" in out.err
    code, out = told(["run"], capsys)
    assert code == 2
    assert "TASK: missing" in out.err


def test_the_export_command_refuses_what_it_cannot_export(run, recording, tmp_path, capsys):
    code, out = told(["export", tmp_path, "--to", "mcap", "--out", tmp_path / "x.mcap"], capsys)
    assert code == 2
    assert "not a folder of omniservo run" in out.err
    code, out = told(["export", run, "--to", "mcap", "--out", recording], capsys)
    assert code == 2
    assert "exists; --force replaces it" in out.err
    code, out = told(["export", tmp_path / "nothing"], capsys)
    assert code == 2


def test_what_stands_between_plan_and_servo_takes_little_memory(tmp_path, monkeypatch):
    monkeypatch.setattr(recorded_job, "MOST_FILES", 2**20)
    path, said = tmp_path / "long.mcap", LogMessage(msg="a" * 2**18)
    for count in (3, 5):
        with RunRecording(path, force=True) as file:
            file.write(topics.MATCH, MatchMessage(), 0.0)
            for _ in range(count):
                file.write(topics.EVENTS, said, 0.0)
        job = recorded_job.RecordedJob(RecordedRun(path))
        if count * 2**18 < 2**20:
            assert job.documents() == (None, None)
        else:
            with pytest.raises(InputError, match="more than 1048576 bytes between plan and servo"):
                job.documents()


def test_another_process_reads_it_alone(recording):
    """What is in a recording does not depend on this process: a new one replays it."""
    found = subprocess.run(
        [sys.executable, "-m", "omniservo.cli.main", "run", "--replay", str(recording), "--json"],
        capture_output=True, text=True, env=os.environ, check=False,
    )  # fmt: skip
    assert found.returncode == 0, found.stderr
    assert json.loads(found.stdout)["largest_difference"] == 0.0
