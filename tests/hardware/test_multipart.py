"""A stream of JPEGs is cut into its parts, in pieces of any size; what is no such stream is named."""

import itertools

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from omniservo.hardware.camera_sources.multipart import (
    MOST_HEAD,
    MOST_PART,
    MultipartError,
    MultipartParser,
    boundary_of,
)

CONTENTS = st.lists(st.binary(min_size=1, max_size=200).filter(lambda b: b"--mark" not in b), max_size=5)


def stream_of(contents, with_length, newline):
    stream = b"a preamble that is no part" + newline
    for content in contents:
        stream += (
            b"--mark" + newline + b"Content-Type: image/jpeg" + newline + b"x-timestamp :  5.5 " + newline
        )
        if with_length:
            stream += b"CONTENT-LENGTH: " + str(len(content)).encode() + newline
        stream += newline + content + b"\r\n"
    return stream + b"--mark--\r\n"


@given(
    contents=CONTENTS,
    with_length=st.booleans(),
    newline=st.sampled_from([b"\r\n", b"\n"]),
    cuts=st.lists(st.integers(0, 1500), max_size=10),
)
@settings(max_examples=300, deadline=None)
def test_parts_come_out_as_they_were_put_in(contents, with_length, newline, cuts):
    stream = stream_of(contents, with_length, newline)
    edges = sorted({0, len(stream), *(cut for cut in cuts if cut < len(stream))})
    parser = MultipartParser(b"mark")
    found = [part for a, b in itertools.pairwise(edges) for part in parser.feed(stream[a:b])]
    assert [content for _, content in found] == contents
    assert all(headers["x-timestamp"] == "5.5" for headers, _ in found)


@pytest.mark.parametrize(
    ("stream", "words"),
    [
        (bytes(MOST_HEAD + 1), "no boundary in"),
        (b"--mark\r\n" + b"x" * (MOST_HEAD + 1), "headers are longer"),
        (b"--mark\r\nContent-Length: -5\r\n\r\n", "an image of -5 bytes"),
        (b"--mark\r\nContent-Length: lots\r\n\r\n", "an image of lots bytes"),
        (b"--mark\r\nContent-Length: 99999999999\r\n\r\n", "an image of 99999999999 bytes"),
        (b"--mark\r\n\r\n" + bytes(MOST_PART + 1), "more than"),
    ],
)
def test_what_is_longer_than_images_are_is_refused(stream, words):
    with pytest.raises(MultipartError, match=words):
        list(MultipartParser(b"mark").feed(stream))


@pytest.mark.parametrize("newline", [b"\r\n", b"\n"])
@pytest.mark.parametrize(("stated", "sent"), [("--x", b"----x"), ("--x", b"--x"), ("x", b"--x")])
def test_parts_without_lengths_end_at_boundaries_as_they_are_stated_or_sent(stated, sent, newline):
    parser = MultipartParser(boundary_of(f"multipart/x-mixed-replace; boundary={stated}"))
    part = sent + newline + b"Content-Type: image/jpeg" + 2 * newline + b"picture" + newline
    found = [content for k in range(0, 3 * len(part), 7) for _, content in parser.feed((3 * part)[k : k + 7])]
    assert found == [b"picture", b"picture"]


@given(stream=st.binary(max_size=500))
@settings(max_examples=200, deadline=None)
def test_any_bytes_are_parts_or_refused(stream):
    parser = MultipartParser(b"m")
    try:
        found = list(parser.feed(b"--m" + stream))
    except MultipartError:
        found = []
    assert sum(len(content) for _, content in found) <= len(stream)


@pytest.mark.parametrize(
    ("content_type", "boundary"),
    [
        ("multipart/x-mixed-replace; boundary=frame", b"frame"),
        ('Multipart/X-Mixed-Replace;boundary="my frame"', b"my frame"),
        ("multipart/x-mixed-replace;charset=a; BOUNDARY=--frame", b"frame"),
    ],
)
def test_boundaries_are_read_as_cameras_state_them(content_type, boundary):
    assert boundary_of(content_type) == boundary


@pytest.mark.parametrize(
    ("content_type", "words"),
    [
        ("text/html; boundary=x", "sends text/html; MJPEG is"),
        ("", "sends no type"),
        ("multipart/x-mixed-replace", "states no boundary"),
    ],
)
def test_what_is_no_mjpeg_is_named(content_type, words):
    with pytest.raises(MultipartError, match=words):
        boundary_of(content_type)
