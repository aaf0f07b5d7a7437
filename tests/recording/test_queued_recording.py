"""Recordings that a thread writes: a slow disk costs images alone, a full one stops nothing."""

import os
import resource
import signal
import subprocess
import sys
from threading import Event

import numpy as np
import pytest

from omniservo.errors import InputError
from omniservo.recording import Attachment, Parameters, QueuedRecording, Recorded, RecordedRun, RunRecording
from omniservo.ros_messages.messages import HeaderMessage, ImageMessage, JointStateMessage, TimeMessage


def image(number, rows=100, columns=200):
    pixels = np.random.default_rng(number).integers(0, 255, rows * columns, dtype=np.uint8)
    return ImageMessage(
        HeaderMessage(TimeMessage.of(0.1 * number)), rows, columns, "mono8", 0, columns, pixels
    )


def joints(number):
    return JointStateMessage(HeaderMessage(TimeMessage.of(0.1 * number)), ["a"], np.array([float(number)]))


def filled(recording, count=20):
    recording.parameters({"task": "x"})
    recording.attach("goal.json", "application/json", b"{}")
    for number in range(count):
        recording.write("/camera/image", image(number), 0.1 * number)
        recording.write("/joint_states", joints(number), 0.1 * number + 0.05)
        recording.write("/joint_commands", joints(number), 0.1 * number + 0.05)


def of(path, topic):
    return [e.message for e in RecordedRun(path) if isinstance(e, Recorded) and e.topic == topic]


def numbers(path, topic):
    return [message.position[0] for message in of(path, topic)]


def test_the_file_is_the_one_that_is_written_at_once(tmp_path):
    with RunRecording(tmp_path / "plain.mcap") as plain:
        filled(plain)
    with QueuedRecording(tmp_path / "queued.mcap") as queued:
        filled(queued)
    assert (tmp_path / "queued.mcap").read_bytes() == (tmp_path / "plain.mcap").read_bytes()
    assert (queued.images, queued.dropped, queued.failure) == (20, 0, None)
    assert sorted(p.name for p in tmp_path.iterdir()) == ["plain.mcap", "queued.mcap"]


def test_what_was_given_is_what_is_written_whatever_becomes_of_the_array(tmp_path):
    with QueuedRecording(tmp_path / "q.mcap") as queued:
        gate = Event()
        queued._put(gate.wait, 0)
        message = joints(3)
        queued.write("/joint_states", message, 0.0)
        message.position[:] = -1.0
        gate.set()
    assert numbers(tmp_path / "q.mcap", "/joint_states") == [3.0]


def slowed(path, **limits):
    """A recording whose disk takes nothing while 20 images come, and then 20 more."""
    queued, gate = QueuedRecording(path, **limits), Event()
    queued._put(gate.wait, 0)
    filled(queued)
    gate.set()
    queued.settle()
    for number in range(20, 40):
        queued.write("/camera/image", image(number), 0.1 * number)
        queued.settle()
    return queued


def test_a_slow_disk_costs_images_alone_and_the_file_says_how_many_where(tmp_path):
    path = tmp_path / "slow.mcap"
    queued = slowed(path, most_images=5 * 20_000 + 5_000)
    state = queued.settle()
    queued.close()
    assert 10 < queued.dropped < 19
    assert (state.images, state.dropped, state.failure) == (40 - queued.dropped, queued.dropped, None)
    assert state.notice == f"the recording lacks {queued.dropped} of 40 images: the disk was too slow"
    assert numbers(path, "/joint_states") == list(range(20))
    assert numbers(path, "/joint_commands") == list(range(20))
    stamps = [round(10 * m.header.stamp.seconds) for m in of(path, "/camera/image")]
    kept = 20 - queued.dropped
    assert stamps == [*range(kept), *range(20, 40)]  # the oldest are there: a replay goes up to the first gap
    entries = list(RecordedRun(path))
    (note,) = [
        k for k, e in enumerate(entries) if isinstance(e, Parameters) and e.name == "omniservo.dropped"
    ]
    assert entries[note].values == {"images": str(queued.dropped)}
    before = [e for e in entries[:note] if isinstance(e, Recorded) and e.topic == "/camera/image"]
    assert len(before) == kept
    (words,) = [message.msg for message in of(path, "/rosout")]
    assert words == f"{queued.dropped} images are missing before this: the disk was too slow"


def test_images_that_are_missing_at_the_end_are_noted_too(tmp_path):
    queued, gate = QueuedRecording(tmp_path / "e.mcap", most_images=50_000), Event()
    queued._put(gate.wait, 0)
    filled(queued, 8)
    gate.set()
    queued.close()
    notes = [e for e in RecordedRun(tmp_path / "e.mcap") if isinstance(e, Parameters)]
    assert notes[-1] == Parameters("omniservo.dropped", {"images": "6"})


def test_a_disk_that_takes_nothing_for_long_ends_the_recording_and_no_more(tmp_path):
    queued = slowed(tmp_path / "s.mcap", most_images=10**9, most_waiting=200_000)
    queued.close()
    assert "wait for the disk" in str(queued.failure)
    assert "the recording ends early, the run went on: " in queued.settle().notice
    assert not (tmp_path / "s.mcap").exists()
    assert list(run := RecordedRun(tmp_path / "s.unfinished.mcap")) == []
    assert run.cut


def test_a_full_disk_ends_the_recording_and_no_more(tmp_path):
    if not os.path.exists("/dev/full"):
        pytest.skip("no /dev/full")
    (tmp_path / "f.unfinished.mcap").symlink_to("/dev/full")
    queued = QueuedRecording(tmp_path / "f.mcap")
    filled(queued)
    notice = queued.settle().notice
    filled(queued)
    queued.close()
    queued.close()
    assert notice.endswith("f.unfinished.mcap: No space left on device")
    assert not (tmp_path / "f.mcap").exists()


SCRIPT = (
    "import sys, time\n"
    "from pathlib import Path\n"
    "from omniservo.recording import QueuedRecording\n"
    "from tests.recording.test_queued_recording import filled\n"
    "queued = QueuedRecording(Path(sys.argv[1]))\n"
    "filled(queued, 40)\n"
    "notice = queued.settle().notice\n"
    "{end}"
    "print(notice, flush=True)\n"
    "time.sleep({sleep})\n"
)


def process(path, end="", sleep=0, limit=None):
    from pathlib import Path

    return subprocess.Popen(
        [sys.executable, "-c", SCRIPT.format(end=end, sleep=sleep), str(path)],
        stdout=subprocess.PIPE, text=True, cwd=Path(__file__).parents[2], env=os.environ,
        preexec_fn=None if limit is None else lambda: resource.setrlimit(resource.RLIMIT_FSIZE, (limit,) * 2),
    )  # fmt: skip


def test_a_disk_that_fills_up_leaves_what_fitted_on_it(tmp_path):
    filling = process(tmp_path / "r.mcap", end="queued.close()\n", limit=300_000)
    said, _ = filling.communicate()
    assert filling.returncode == 0
    assert "the recording ends early, the run went on: " in said
    assert "File too large" in said
    states = numbers(tmp_path / "r.unfinished.mcap", "/joint_states")
    assert states == list(range(len(states)))
    assert 10 < len(states) < 40


def test_a_killed_process_leaves_what_it_had_written(tmp_path):
    killed = process(tmp_path / "r.mcap", sleep=60)
    assert killed.stdout is not None
    assert killed.stdout.readline() == "\n"
    killed.send_signal(signal.SIGKILL)
    killed.communicate()
    entries = list(run := RecordedRun(tmp_path / "r.unfinished.mcap"))
    assert run.cut
    assert isinstance(entries[1], Attachment)
    states = numbers(tmp_path / "r.unfinished.mcap", "/joint_states")
    assert states == list(range(len(states)))
    assert len(states) > 30


def test_a_file_that_cannot_be_begun_is_one_message(tmp_path):
    with pytest.raises(InputError, match="does not exist"):
        QueuedRecording(tmp_path / "none" / "r.mcap")


def test_nothing_is_left_of_what_is_discarded(tmp_path):
    queued = QueuedRecording(tmp_path / "d.mcap")
    filled(queued)
    queued.discard()
    queued.write("/joint_states", joints(1), 9.0)  # a late caller is no error
    assert list(tmp_path.iterdir()) == []


def test_two_other_readers_read_it(tmp_path):
    reader = pytest.importorskip("mcap.reader", reason="reads MCAP independently")
    highlevel = pytest.importorskip("rosbags.highlevel", reason="reads bags independently")
    path = tmp_path / "slow.mcap"
    slowed(path, most_images=105_000).close()
    with path.open("rb") as stream:
        found = reader.make_reader(stream, validate_crcs=True)
        topics = [channel.topic for _, channel, _ in found.iter_messages()]
        noted = [each.metadata for each in found.iter_metadata() if each.name == "omniservo.dropped"]
    with highlevel.AnyReader([path]) as bag:
        seen = [connection.topic for connection, _, _ in bag.messages()]
    for topic, count in {"/joint_states": 20, "/joint_commands": 20, "/rosout": 1}.items():
        assert topics.count(topic) == seen.count(topic) == count
    assert topics.count("/camera/image") == seen.count("/camera/image") == 40 - int(noted[0]["images"])
