"""Packets of RTDE are cut, packed and unpacked as agreed; whatever else is heard is refused by name."""

import itertools
import struct
from contextlib import suppress

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from omniservo.hardware.rtde.packets import FORMATS, PacketBuffer, PacketError, PacketKind, Recipe, packet

PACKETS = st.lists(st.tuples(st.sampled_from(list(PacketKind)), st.binary(max_size=300)), max_size=6)


@given(packets=PACKETS, cuts=st.lists(st.integers(0, 2000), max_size=8))
@settings(max_examples=200, deadline=None)
def test_a_stream_gives_its_packets_however_it_is_cut(packets, cuts):
    stream = b"".join(packet(kind, body) for kind, body in packets)
    edges = sorted({0, len(stream), *(cut for cut in cuts if cut < len(stream))})
    buffer = PacketBuffer()
    parts = [stream[a:b] for a, b in itertools.pairwise(edges)]
    assert [found for part in parts for found in buffer.feed(part)] == packets


@given(stream=st.binary(max_size=400))
@settings(max_examples=300, deadline=None)
def test_any_bytes_are_packets_or_refused_by_name(stream):
    found = []
    with suppress(PacketError):
        found.extend(PacketBuffer().feed(stream))
    assert stream.startswith(b"".join(packet(kind, body) for kind, body in found))


@pytest.mark.parametrize(
    ("stream", "words"),
    [
        (b"\0\0U", "a packet of 0 bytes"),
        (b"\0\2U", "a packet of 2 bytes"),
        (b"HTTP/1.1 400", "unknown kind 84"),
        (b"SSH-2.0", "unknown kind 72"),
    ],
)
def test_other_protocols_are_recognised_by_their_first_bytes(stream, words):
    with pytest.raises(PacketError, match=words):
        list(PacketBuffer().feed(stream))


def test_a_body_that_no_length_can_state_is_refused():
    assert len(packet(PacketKind.TEXT, bytes(0xFFFC))) == 0xFFFF
    with pytest.raises(PacketError, match="65533 bytes; at most 65532"):
        packet(PacketKind.TEXT, bytes(0xFFFD))


def test_data_comes_back_as_it_was_packed_big_endian():
    recipe = Recipe(3, ["DOUBLE", "INT32", "VECTOR3D", "BOOL", "UINT64"])
    body = recipe.pack([0.5, -2, 1.0, 2.0, 3.0, True, 2**63])
    assert body == b"\3" + struct.pack(">d", 0.5) + b"\xff\xff\xff\xfe" + struct.pack(
        ">3d", 1, 2, 3
    ) + b"\1" + struct.pack(">Q", 2**63)
    assert recipe.unpack(body) == [(0.5,), (-2,), (1.0, 2.0, 3.0), (True,), (2**63,)]


@pytest.mark.parametrize(
    ("body", "words"),
    [
        (b"", "data of 0 bytes; agreed were 13"),
        (bytes(12), "data of 12 bytes"),
        (bytes(14), "data of 14 bytes"),
        (b"\5" + bytes(12), "data of recipe 5; agreed was 2"),
    ],
)
def test_data_of_another_form_is_refused(body, words):
    with pytest.raises(PacketError, match=words):
        Recipe(2, ["DOUBLE", "INT32"]).unpack(body)


def test_an_unknown_type_is_refused():
    with pytest.raises(PacketError, match="unknown type 'MATRIX'"):
        Recipe(1, [*FORMATS, "MATRIX"])
