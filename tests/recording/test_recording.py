"""Recordings: other readers agree with what was written; a cut file is read to the cut; damage is named."""

import os
import signal
import struct
import subprocess
import sys
import zlib
from pathlib import Path

import numpy as np
import pytest
import zstandard
from mcap.writer import Writer

from omniservo.errors import InputError, NotWritten
from omniservo.recording import Attachment, Parameters, Recorded, RecordedRun, RunRecording
from omniservo.recording.recorded_messages import (
    FramesMessage,
    LogMessage,
    PathMessage,
    PoseStampedMessage,
    StepMessage,
    TransformStampedMessage,
)
from omniservo.recording.topics import TYPES
from omniservo.ros_messages import definition, encode
from omniservo.ros_messages.messages import (
    HeaderMessage,
    ImageMessage,
    JointStateMessage,
    RosMessage,
    TimeMessage,
)


def image(seed, rows=24, columns=32):
    pixels = np.random.default_rng(seed).integers(0, 255, (rows, columns), dtype=np.uint8)
    header = HeaderMessage(TimeMessage.of(0.1 * seed), "camera")
    return ImageMessage(header, rows, columns, "mono8", 0, columns, pixels.ravel())


def filled(kind, random):
    """Return a message with something in every field."""
    values = []
    for name, of, many in kind.wire_fields():
        if isinstance(of, type) and issubclass(of, RosMessage):
            value = [filled(of, random) for _ in range(2)] if many else filled(of, random)
        elif of is str:
            value = ["elbow", "wrist 1 é"] if many else name
        elif hasattr(of, "code"):
            value = float(random.normal()) if of.code == "d" else int(random.integers(0, 2))
        elif of.dtype == "u1":
            value = random.integers(0, 255, of.count or 5, dtype=np.uint8)
        else:
            value = random.normal(size=of.count or 4)
        values.append(value)
    return kind(*values)


def same(ours, theirs):
    """Whether another reader's message has what ours has, field by field."""
    for name, of, many in type(ours).wire_fields():
        mine, other = getattr(ours, name), getattr(theirs, name)
        if isinstance(of, type) and issubclass(of, RosMessage):
            pairs = zip(mine, other, strict=True) if many else [(mine, other)]
            if not all(same(a, b) for a, b in pairs):
                return False
        elif isinstance(mine, np.ndarray):
            theirs_bytes = np.frombuffer(other, np.uint8) if isinstance(other, bytes) else np.asarray(other)
            if not np.array_equal(mine, theirs_bytes, equal_nan=True):
                return False
        elif list(mine) != list(other) if many else mine != other:
            return False
    return True


@pytest.fixture
def messages():
    random = np.random.default_rng(7)
    return {topic: filled(kind, random) for topic, kind in TYPES.items()}


@pytest.fixture
def file(tmp_path, messages):
    with RunRecording(tmp_path / "run.mcap") as recording:
        recording.parameters({"task": "paper-example-1", "seed": "3"})
        recording.attach("files/task.yaml", "application/yaml", b"name: x\n")
        for number, (topic, message) in enumerate(messages.items()):
            recording.write(topic, message, 1.5 + 0.1 * number, stamp=1.4 + 0.1 * number)
    return tmp_path / "run.mcap"


def test_what_is_read_is_what_was_written_in_that_order(file, messages):
    entries = list(run := RecordedRun(file))
    assert not run.cut
    assert entries[0] == Parameters(
        "omniservo", {"format": "omniservo.recording/1", "task": "paper-example-1", "seed": "3"}
    )
    assert entries[1] == Attachment("files/task.yaml", b"name: x\n")
    assert [entry.topic for entry in entries[2:]] == list(messages)
    assert all(same(messages[entry.topic], entry.message) for entry in entries[2:])
    np.testing.assert_allclose([e.time for e in entries[2:]], 1.5 + 0.1 * np.arange(len(messages)), atol=1e-9)


def test_topics_of_others_are_passed_over(tmp_path):
    with (tmp_path / "a.mcap").open("wb") as stream:
        writer = Writer(stream)
        writer.start(profile="ros2", library="another")
        schema = writer.register_schema("std_msgs/msg/String", "ros2msg", b"string data\n")
        channel = writer.register_channel("/chatter", "cdr", schema)
        writer.add_message(channel, 10, b"\0\1\0\0\2\0\0\0a\0", 10)
        kind = TYPES["/rosout"]
        schema = writer.register_schema(kind.ros_type, "ros2msg", definition(kind).encode())
        writer.add_message(writer.register_channel("/rosout", "cdr", schema), 20, encode(LogMessage()), 20)
        writer.finish()
    (entry,) = RecordedRun(tmp_path / "a.mcap")
    assert (entry.topic, entry.time) == ("/rosout", pytest.approx(20e-9))


def test_an_attachment_stands_behind_the_messages_before_it(tmp_path):
    with RunRecording(tmp_path / "a.mcap") as recording:
        recording.write("/camera/image", image(1), 1.0)
        recording.attach("plan.json", "application/json", b"{}")
        recording.write("/camera/image", image(2), 2.0)
    kinds = [type(entry) for entry in RecordedRun(tmp_path / "a.mcap")]
    assert kinds == [Recorded, Attachment, Recorded]


def test_the_decoder_of_mcap_reads_the_same(file, messages):
    reader = pytest.importorskip("mcap.reader", reason="reads MCAP independently")
    decoder = pytest.importorskip("mcap_ros2.decoder", reason="reads ROS 2's messages independently")
    with file.open("rb") as stream:
        found = reader.make_reader(stream, decoder_factories=[decoder.DecoderFactory()], validate_crcs=True)
        summary = found.get_summary()
        seen = {channel.topic: (m, ros) for _, channel, m, ros in found.iter_decoded_messages()}
        names = [attachment.name for attachment in found.iter_attachments()]
        values = [metadata.metadata["task"] for metadata in found.iter_metadata()]
    assert set(seen) == set(messages)
    assert all(same(messages[topic], ros) for topic, (_, ros) in seen.items())
    first = seen["/camera/image"][0]
    assert (first.log_time, first.publish_time) == (1_500_000_000, 1_400_000_000)
    assert names == ["files/task.yaml"]
    assert values == ["paper-example-1"]
    assert summary.statistics.message_count == len(messages)


def test_rosbags_reads_the_same(file, messages):
    highlevel = pytest.importorskip("rosbags.highlevel", reason="reads bags independently")
    seen = {}
    with highlevel.AnyReader([file]) as reader:
        for connection, _, raw in reader.messages():
            seen[connection.topic] = reader.deserialize(raw, connection.msgtype)
    assert set(seen) == set(messages)
    assert all(same(messages[topic], seen[topic]) for topic in messages)


def test_definitions_are_those_of_ros():
    typesys = pytest.importorskip("rosbags.typesys", reason="knows ROS 2's definitions")
    from omniservo.ros_messages import definition

    store = typesys.get_typestore(typesys.Stores.ROS2_HUMBLE)
    for kind in TYPES.values():
        parsed = typesys.get_types_from_msg(definition(kind), kind.ros_type)
        for name, (_, fields) in parsed.items():
            if name in store.fielddefs:
                assert fields == store.fielddefs[name][1], name
            else:
                assert name.startswith("omniservo_msgs/msg/")


def test_a_file_cut_anywhere_is_read_up_to_the_cut(tmp_path):
    with RunRecording(tmp_path / "whole.mcap") as recording:
        recording.attach("goal.json", "application/json", b"g" * 1000)
        for number in range(30):
            recording.write("/camera/image", image(number, 200, 300), 0.1 * number)
    data = (tmp_path / "whole.mcap").read_bytes()
    part, counts = tmp_path / "part.mcap", []
    for end in np.linspace(8, len(data), 60).astype(int):
        part.write_bytes(data[:end])
        entries = list(run := RecordedRun(part))
        images = [e.message for e in entries if isinstance(e, Recorded)]
        assert all(same(found, image(number, 200, 300)) for number, found in enumerate(images))
        assert run.cut or len(images) == 30
        counts.append(len(images))
    assert counts == sorted(counts)
    assert (counts[0], counts[-1]) == (0, 30)
    assert len(set(counts)) > 5  # not all or nothing


def test_a_killed_process_leaves_what_it_had_written(tmp_path):
    script = (
        "import sys, time, numpy as np\n"
        "from omniservo.recording import RunRecording\n"
        "from omniservo.ros_messages.messages import ImageMessage\n"
        "recording = RunRecording(sys.argv[1])\n"
        "data = np.random.default_rng(0).integers(0, 255, 300 * 400, dtype=np.uint8)\n"
        "for number in range(20):\n"
        "    recording.write('/camera/image', ImageMessage(height=300, width=400, data=data), 0.1 * number)\n"
        "print('written', flush=True)\n"
        "time.sleep(60)\n"
    )
    path = tmp_path / "run.mcap"
    process = subprocess.Popen(
        [sys.executable, "-c", script, str(path)], stdout=subprocess.PIPE, env=os.environ, text=True
    )
    assert process.stdout is not None
    assert process.stdout.readline().strip() == "written"
    process.send_signal(signal.SIGKILL)
    process.communicate()
    assert not path.exists()
    found = list(run := RecordedRun(tmp_path / "run.unfinished.mcap"))
    assert run.cut
    assert len(found) >= 18  # all but the last chunk


def test_a_file_of_that_name_is_not_overwritten(file):
    before = file.read_bytes()
    with pytest.raises(InputError, match="exists"):
        RunRecording(file)
    assert file.read_bytes() == before
    RunRecording(file, force=True).close()
    assert file.read_bytes() != before


@pytest.mark.parametrize("time", [np.nan, np.inf, 1e12])
@pytest.mark.parametrize("of", ["time", "stamp"])
def test_a_time_that_is_none_is_refused(tmp_path, time, of):
    path = tmp_path / "run.mcap"
    with RunRecording(path) as recording, pytest.raises(InputError, match="time"):
        recording.write("/rosout", LogMessage(msg="?"), **({"time": 0.0} | {of: time}))
    assert list(RecordedRun(path)) == []


def record(kind, content):
    return struct.pack("<BQ", kind, len(content)) + content


def text(value):
    return struct.pack("<I", len(value)) + value.encode()


def chunk(data, size=None, compression="zstd", packed=None, checksum=None):
    packed = zstandard.compress(data) if packed is None else packed
    size = len(data) if size is None else size
    checksum = zlib.crc32(data) if checksum is None else checksum
    return record(
        6,
        struct.pack("<QQQI", 0, 0, size, checksum)
        + text(compression)
        + struct.pack("<Q", len(packed))
        + packed,
    )


MAGIC = b"\x89MCAP0\r\n"
SCHEMA = record(3, struct.pack("<H", 1) + text("sensor_msgs/msg/Image") + text("ros2msg") + text(""))
CHANNEL = record(4, struct.pack("<HH", 1, 1) + text("/camera/image") + text("cdr") + text(""))
LONG = b"\0" * 2**20

DAMAGED = {
    "not MCAP": (b"\x89PNG\r\n\x1a\n" + b"\0" * 100, "not an MCAP file"),
    "empty": (b"", "not an MCAP file"),
    "a record larger than may be": (
        MAGIC + struct.pack("<BQ", 6, 2**62) + b"x",
        "at most 268435456 are read",
    ),
    "a chunk that says it is larger than may be": (MAGIC + chunk(b"", 2**40), "at most 268435456"),
    "a chunk that grows beyond what it says": (
        MAGIC + chunk(LONG, size=10),
        "more or fewer bytes than the 10",
    ),
    "a chunk that is less than it says": (MAGIC + chunk(b"abc", size=10), "more or fewer"),
    "a wrong checksum": (MAGIC + chunk(SCHEMA, checksum=1), "checksum is wrong"),
    "another compression": (MAGIC + chunk(SCHEMA, compression="lz4"), "legal: 'zstd'"),
    "no compressed data": (MAGIC + chunk(SCHEMA, packed=b"garbage"), "does not decompress"),
    "a record beyond its chunk": (MAGIC + chunk(struct.pack("<BQ", 5, 99)), "has 0 left"),
    "a head beyond its chunk": (MAGIC + chunk(b"\5\1"), "damaged at byte 8"),
    "another type on our topic": (
        MAGIC + SCHEMA.replace(b"sensor_msgs/msg/Image", b"sensor_msgs/msg/Joint") + CHANNEL,
        "legal: sensor_msgs/msg/Image",
    ),
    "another encoding": (MAGIC + SCHEMA + CHANNEL.replace(b"cdr", b"cbo"), "'cdr'"),
    "a message that is none": (
        MAGIC + SCHEMA + CHANNEL + record(5, struct.pack("<HIQQ", 1, 0, 0, 0) + b"\0\1\0\0" + b"\xff" * 40),
        "/camera/image",
    ),
    "text that is none": (MAGIC + record(12, struct.pack("<I", 2) + b"\xff\xfe" + text("")), "utf-8"),
    "an attachment with another checksum": (
        MAGIC + record(9, b"\0" * 16 + text("a") + text("b") + struct.pack("<Q", 1) + b"x" + b"\1\2\3\4"),
        "attachment 'a'",
    ),
}


@pytest.mark.parametrize("name", DAMAGED)
def test_what_is_damaged_is_named_with_its_place(tmp_path, name):
    data, words = DAMAGED[name]
    path = tmp_path / "damaged.mcap"
    path.write_bytes(data)
    with pytest.raises(InputError) as told:
        list(RecordedRun(path))
    assert str(path) in str(told.value)
    assert words in str(told.value)


def test_a_chunk_that_grows_takes_no_memory(tmp_path):
    import tracemalloc

    bomb = zstandard.compress(bytes(2**30 - 1))
    path = tmp_path / "bomb.mcap"
    path.write_bytes(MAGIC + chunk(b"", size=100, packed=bomb, checksum=0))
    tracemalloc.start()
    with pytest.raises(InputError, match="more or fewer"):
        list(RecordedRun(path))
    assert tracemalloc.get_traced_memory()[1] < 2**26
    tracemalloc.stop()


def test_long_names_of_types_take_no_memory(tmp_path):
    import tracemalloc

    path, long = tmp_path / "names.mcap", "a" * 2**22
    schemas = [record(3, struct.pack("<H", i) + text(long) + text("") + text("")) for i in range(20)]
    path.write_bytes(MAGIC + b"".join(map(chunk, schemas)))
    recorded = RecordedRun(path)
    tracemalloc.start()
    assert list(recorded) == []
    assert tracemalloc.get_traced_memory()[1] < 8 * 2**22
    tracemalloc.stop()


def test_no_flipped_byte_makes_another_error_than_one_in_words(file):
    data = file.read_bytes()
    random = np.random.default_rng(0)
    path = file.with_name("flipped.mcap")
    refused = 0
    for _ in range(300):
        flipped = bytearray(data)
        for at in random.integers(8, len(data), 3):
            flipped[at] = random.integers(256)
        path.write_bytes(flipped)
        try:
            list(RecordedRun(path))
        except InputError:
            refused += 1
    assert refused > 50


def test_messages_of_a_long_path_fit(tmp_path):
    path = PathMessage(poses=[PoseStampedMessage() for _ in range(200)])
    frames = FramesMessage([TransformStampedMessage(child_frame_id="camera")])
    with RunRecording(tmp_path / "p.mcap") as recording:
        recording.write("/planned_path", path, 0.0)
        recording.write("/tf", frames, 0.0)
        recording.write("/rosout", LogMessage(msg="é"), 0.0)
        recording.write("/joint_states", JointStateMessage(name=["a"]), 0.0)
        recording.write("/omniservo/step", StepMessage(), 0.0)
    assert len(list(RecordedRun(tmp_path / "p.mcap"))) == 5
    assert Path(tmp_path / "p.unfinished.mcap").exists() is False


@pytest.mark.skipif(not os.path.exists("/dev/full"), reason="no /dev/full")
def test_a_full_disk_is_named_whatever_is_written_and_leaves_nothing_once_discarded(tmp_path):
    random = np.random.default_rng(0)
    writes = {
        "attach": lambda recording: recording.attach("plan", "text/plain", random.bytes(10**6)),
        "write": lambda recording: recording.write("/camera/image", image(1, 1000, 1000), 0.0),
        "parameters": lambda recording: recording.parameters({"task": random.bytes(10**5).hex()}),
    }
    for name, write in writes.items():
        unfinished = tmp_path / f"{name}.unfinished.mcap"
        unfinished.symlink_to("/dev/full")
        recording = RunRecording(tmp_path / f"{name}.mcap")
        with pytest.raises(NotWritten, match=f"{unfinished}: No space left on device"):
            write(recording)
        recording.discard()
        assert not list(tmp_path.iterdir())


def test_two_recordings_of_one_name_and_what_a_killed_one_left_do_not_mix(tmp_path):
    left = tmp_path / "run.unfinished.mcap"
    left.write_bytes(b"of a run that was killed")
    numbers = range(40)
    both = [RunRecording(tmp_path / "run.mcap") for _ in range(2)]
    for number in numbers:
        for name, recording in zip("ab", both, strict=True):
            recording.write("/rosout", LogMessage(name=name, msg=f"{number}" * 10_000), 0.1 * number)
    for name, recording in zip("ab", both, strict=True):
        recording.close()
        messages = [entry.message for entry in RecordedRun(tmp_path / "run.mcap")]
        assert [message.name for message in messages] == [name] * len(numbers)
    assert left.read_bytes() == b"of a run that was killed"
    assert sorted(path.name for path in tmp_path.iterdir()) == ["run.mcap", "run.unfinished.mcap"]


def test_a_recording_that_has_just_begun_can_be_read(tmp_path):
    with RunRecording(tmp_path / "run.mcap") as recording:
        begun = RecordedRun(recording.unfinished)
        assert list(begun) == []
        assert begun.cut
