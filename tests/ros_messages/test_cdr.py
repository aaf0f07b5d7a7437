"""Our bytes of ROS 2 messages are those of rosbags, and what is no message is refused by name."""

import tracemalloc

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from omniservo.errors import InputError
from omniservo.ros_messages import messages
from omniservo.ros_messages.cdr import MOST_ITEMS, decode, encode
from omniservo.ros_messages.messages import (
    Float64MultiArrayMessage,
    HeaderMessage,
    ImageMessage,
    JointStateMessage,
    JointTrajectoryMessage,
    Numbers,
    RosMessage,
    Scalar,
    TimeMessage,
)

typesys = pytest.importorskip("rosbags.typesys", reason="rosbags judges the codec")
STORE = typesys.get_typestore(typesys.Stores.ROS2_JAZZY)
KINDS = sorted(
    (
        k
        for k in vars(messages).values()
        if isinstance(k, type) and issubclass(k, RosMessage) and k is not RosMessage
    ),
    key=lambda k: k.ros_type,
)
by_type = pytest.mark.parametrize("kind", KINDS, ids=lambda k: k.ros_type)

SCALARS = {
    "i": st.integers(-(2**31), 2**31 - 1),
    "I": st.integers(0, 2**32 - 1),
    "B": st.integers(0, 255),
    "?": st.booleans(),
    "d": st.floats(allow_nan=False),
}
TEXT = st.text(st.characters(codec="utf-8", exclude_characters="\0"), max_size=9)


def values(kind):
    if isinstance(kind, Scalar):
        return SCALARS[kind.code]
    if isinstance(kind, Numbers):
        one = st.integers(0, 255) if kind.dtype == "u1" else st.floats(allow_nan=False)
        low, high = (0, 9) if kind.count is None else (kind.count, kind.count)
        return st.lists(one, min_size=low, max_size=high).map(lambda v: np.array(v, kind.dtype))
    if kind is str:
        return TEXT
    rows = {
        name: st.lists(values(of), max_size=4) if many else values(of)
        for name, of, many in kind.wire_fields()
    }
    return st.builds(kind, **rows)


def theirs(message):
    """Return the same message as rosbags has it."""
    fields = {}
    for name, kind, many in message.wire_fields():
        value = getattr(message, name)
        if isinstance(kind, type) and issubclass(kind, RosMessage):
            value = [theirs(v) for v in value] if many else theirs(value)
        fields[name] = value
    return STORE.types[message.ros_type](**fields)


def serialised(message):
    return bytes(STORE.serialize_cdr(theirs(message), message.ros_type))


@by_type
def test_type_hashes_are_those_of_the_definitions(kind):
    assert kind.type_hash == STORE.hash_rihs01(kind.ros_type)


@by_type
@settings(max_examples=25, deadline=None)
@given(data=st.data())
def test_bytes_are_those_of_another_implementation_and_read_back_both_ways(kind, data):
    message = data.draw(values(kind))
    ours = encode(message)
    assert ours == serialised(message)
    assert encode(decode(kind, ours)) == ours
    assert bytes(STORE.serialize_cdr(STORE.deserialize_cdr(ours, kind.ros_type), kind.ros_type)) == ours


@by_type
@settings(max_examples=12, deadline=None)
@given(data=st.data())
def test_every_cut_is_refused_and_padding_is_not(kind, data):
    whole = encode(data.draw(values(kind)))
    for padding in range(4):
        assert encode(decode(kind, whole + bytes(padding))) == whole
    with pytest.raises(InputError, match="4 bytes are left over: a message of another type"):
        decode(kind, whole + bytes(4))
    for end in {*range(min(8, len(whole))), len(whole) // 2, len(whole) - 1}:
        with pytest.raises(InputError, match=rf"^{kind.ros_type}"):
            decode(kind, whole[:end])


@by_type
@settings(max_examples=50, deadline=None)
@given(data=st.data())
def test_any_bytes_are_a_message_or_are_refused_by_name(kind, data):
    """Whole messages with a few bytes changed get deeper than bytes at random."""
    raw = bytearray(encode(data.draw(values(kind))))
    for _ in range(data.draw(st.integers(0, 4))):
        raw[data.draw(st.integers(0, len(raw) - 1))] = data.draw(st.integers(0, 255))
    raw += data.draw(st.binary(max_size=12))
    try:
        message = decode(kind, bytes(raw))
    except InputError as error:
        if not str(error).startswith(kind.ros_type):
            raise
    else:
        assert encode(message)[:4] == raw[:2] + bytes(2)


@pytest.mark.parametrize(
    ("head", "name"),
    [
        (b"\0\0\0\0", "big-endian CDR"),
        (b"\0\x03\0\0", "a parameter list"),
        (b"\0\x07\0\0", "XCDR 2"),
        (b"\0\x09\0\0", "delimited XCDR 2"),
        (b"GET ", "form 0x4745"),
    ],
)
def test_another_form_is_refused_by_its_name(head, name):
    with pytest.raises(InputError, match=f"sent as {name}; legal: little-endian CDR, version 1"):
        decode(TimeMessage, head + bytes(8))


STAMP, NO_TEXT = b"\0\1\0\0" + bytes(8), b"\1\0\0\0" + bytes(4)
CLAIMS = {
    "image": (ImageMessage, STAMP + NO_TEXT + bytes(8) + NO_TEXT + bytes(4), ".data: "),
    "joints": (JointStateMessage, STAMP + NO_TEXT, ".name: "),
    "points": (JointTrajectoryMessage, STAMP + NO_TEXT + bytes(4), ".points: "),
}


@pytest.mark.parametrize("case", CLAIMS)
@pytest.mark.parametrize("claimed", [2**32 - 1, 2**31, 10**9, MOST_ITEMS + 1])
def test_a_length_beyond_the_end_is_refused_and_takes_no_memory(case, claimed):
    kind, head, place = CLAIMS[case]
    raw = head + claimed.to_bytes(4, "little") + bytes(64)
    tracemalloc.start()
    try:
        with pytest.raises(InputError, match=f"^{kind.ros_type}{place}.*{claimed}"):
            decode(kind, raw)
        assert tracemalloc.get_traced_memory()[1] < 100_000
    finally:
        tracemalloc.stop()


def test_a_truth_value_is_0_or_1():
    region = messages.RegionOfInterestMessage(do_rectify=True)
    raw = bytearray(encode(region))
    assert decode(type(region), bytes(raw)).do_rectify is True
    raw[-1] = 2
    with pytest.raises(InputError, match=r"RegionOfInterest.do_rectify: 2 is no truth value; legal: 0, 1"):
        decode(type(region), bytes(raw))


@pytest.mark.slow
def test_the_most_points_take_little_memory():
    """24 bytes make a trajectory point of five objects."""
    raw = encode(JointTrajectoryMessage())[:-4] + MOST_ITEMS.to_bytes(4, "little") + bytes(24 * MOST_ITEMS)
    tracemalloc.start()
    try:
        assert len(decode(JointTrajectoryMessage, raw).points) == MOST_ITEMS
        assert tracemalloc.get_traced_memory()[1] < 40 * len(raw)
    finally:
        tracemalloc.stop()


def test_an_images_bytes_are_not_copied():
    raw = encode(ImageMessage(data=np.arange(256, dtype=np.uint8)))
    assert np.shares_memory(decode(ImageMessage, raw).data, np.frombuffer(raw, np.uint8))


@pytest.mark.parametrize(
    ("message", "words"),
    [
        (ImageMessage(height=-1), r"sensor_msgs/msg/Image.height: -1 given"),
        (ImageMessage(encoding="a\0b"), r"sensor_msgs/msg/Image.encoding: .*no text has a NUL"),
        (ImageMessage(data=np.array([7, 300])), r"Image.data: 300 given; legal: 0 to 255"),
        (ImageMessage(data=np.array([np.nan])), r"Image.data: nan given; legal: 0 to 255"),
        (HeaderMessage(TimeMessage(2**31)), r"std_msgs/msg/Header.stamp.sec: 2147483648 given"),
        (HeaderMessage("now"), r"Header.stamp: 'now' given; legal: TimeMessage"),
        (messages.CameraInfoMessage(k=np.zeros(8)), r"CameraInfo.k: 8 numbers given; legal: 9"),
        (Float64MultiArrayMessage(data="one"), r"Float64MultiArray.data: 'one' given"),
        (JointStateMessage(name=["a"] * (MOST_ITEMS + 1)), r"JointState.name: 10001 items given"),
    ],
)
def test_a_value_that_does_not_fit_is_refused_by_its_field(message, words):
    with pytest.raises(InputError, match=words):
        encode(message)


def test_times_before_and_after_1970_keep_their_nanoseconds():
    for seconds, sec, nanosec in (
        (-0.25, -1, 750_000_000),
        (0.0, 0, 0),
        (1.9999999999, 2, 0),
        (7.5, 7, 500_000_000),
    ):
        message = TimeMessage.of(seconds)
        assert (message.sec, message.nanosec) == (sec, nanosec)
        assert message.seconds == pytest.approx(seconds, abs=1e-9)


def test_a_message_says_what_its_fields_are():
    assert [row[0] for row in HeaderMessage.wire_fields()] == ["stamp", "frame_id"]
