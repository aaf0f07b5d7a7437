"""MJPEG by HTTP: our client on our server and on streams written by hand, OpenCV on our server."""

import base64
import io
import socket
import time
from itertools import pairwise
from urllib.parse import urlsplit

import cv2
import numpy as np
import pytest
from PIL import ExifTags, Image
from tests.hardware.wall_clock_arm import PATIENCE, wait_for
from tests.hardware.wall_clock_camera import WallClockCamera, exposed, written

from omniservo.errors import InputError, InvalidData
from omniservo.hardware import LinkFaults
from omniservo.hardware.camera_sources import open_camera
from omniservo.hardware.camera_sources.mjpeg_reader import MjpegReader, decoded
from omniservo.hardware.camera_sources.mjpeg_server import MjpegServer
from omniservo.hardware.listener import Listener
from omniservo.robots import CameraSource


def images(camera, count):
    """Return so many images, each a new one."""
    found = [camera.image()]
    while len(found) < count:
        before = found[-1]
        found.append(wait_for(lambda: camera.image() if camera.image() is not before else None))  # noqa: B023
    return found


def test_every_image_says_when_it_was_exposed():
    faults = LinkFaults(clock_offset=-100.0, drift_ppm=100.0)
    with MjpegServer(WallClockCamera(), faults=faults) as server:
        camera = open_camera(server.url, patience=PATIENCE)
        try:
            assert isinstance(camera, CameraSource)
            assert (camera.size, camera.trouble) == ((640, 48), None)
            assert camera.notice.startswith("exposure is the sender's time stamp")
            found = images(camera, 30)
            now = time.monotonic()
        finally:
            camera.close()
            camera.close()
    late = [image.time - exposed(image.pixels) for image in found]
    assert min(late) > -0.002
    assert np.median(late) < 0.05  # the least delay of a busy machine
    assert all(a.time < b.time for a, b in pairwise(found))
    assert found[-1].time <= now
    assert all(0.0 < image.time_sigma < 0.1 for image in found)


def test_the_servers_clock_is_off_and_drifts_as_its_faults_say():
    with MjpegServer(WallClockCamera(), faults=LinkFaults(clock_offset=-100.0, drift_ppm=1e4)) as server:
        begin = time.monotonic()
        reader = MjpegReader(urlsplit(server.url), PATIENCE)
        for _ in range(30):
            frame = reader.read()
            off = frame.stamp - exposed(frame.pixels) + 100.0
            assert off == pytest.approx(0.01 * (exposed(frame.pixels) - begin), abs=0.002)
        reader.close()


def test_without_stamps_the_arrival_counts_and_that_is_said():
    with MjpegServer(WallClockCamera(), stamps=False) as server:
        camera = open_camera(server.url, patience=PATIENCE)
        try:
            assert camera.notice.startswith(
                "frames carry no usable time stamp: exposure is taken to be their"
            )
            found = images(camera, 20)
        finally:
            camera.close()
    late = [image.time - exposed(image.pixels) for image in found]
    assert min(late) > -0.002
    assert all(image.time_sigma >= 0.002 for image in found)


@pytest.mark.slow
def test_delay_jitter_and_loss_are_put_in():
    with MjpegServer(WallClockCamera(), faults=LinkFaults(latency=0.2, jitter=0.03, loss=0.2)) as server:
        camera = open_camera(server.url, patience=PATIENCE)
        try:
            ages = [time.monotonic() - exposed(image.pixels) for image in images(camera, 20)]
        finally:
            camera.close()
    assert min(ages) > 0.15


def test_opencv_reads_our_server():
    with MjpegServer(WallClockCamera()) as server:
        capture = cv2.VideoCapture(server.url, cv2.CAP_FFMPEG)
        stamps = []
        for _ in range(10):
            found, pixels = capture.read()
            assert found
            assert pixels.shape == (48, 640, 3)
            stamps.append(exposed(pixels[:, :, 0]))
        capture.release()
    assert all(a < b for a, b in pairwise(stamps))


@pytest.mark.parametrize("request_line", [b"POST / HTTP/1.1\r\n\r\n", b"x" * 20000])
def test_what_is_no_question_for_images_gets_none(request_line):
    with (
        MjpegServer(WallClockCamera()) as server,
        socket.create_connection(("127.0.0.1", int(server.url.split(":")[2].strip("/")))) as line,
    ):
        line.sendall(request_line)
        heard = b""
        try:
            while part := line.recv(4096):
                heard += part
        except ConnectionResetError:
            pass
        assert b"jpeg" not in heard
        assert server.clients == 0


def test_a_client_that_leaves_is_forgotten():
    with MjpegServer(WallClockCamera()) as server:
        camera = open_camera(server.url, patience=PATIENCE)
        assert server.clients == 1
        camera.close()
        wait_for(lambda: server.clients == 0)


def test_a_size_that_changes_is_a_fault_from_then_on():
    source = WallClockCamera()
    with MjpegServer(source) as server:
        camera = open_camera(server.url, patience=PATIENCE)
        source.size = (648, 48)

        def fault():
            try:
                camera.image()
            except InvalidData as error:
                return str(error)
            return None

        assert "frames of 648×48 pixels; 640×48 were expected" in wait_for(fault)
        source.size = (640, 48)
        with pytest.raises(InvalidData):
            camera.image()
        camera.close()


@pytest.mark.slow
def test_a_camera_that_was_lost_comes_back_by_itself():
    source = WallClockCamera()
    server = MjpegServer(source)
    port = int(server.url.split(":")[2].strip("/"))
    camera = open_camera(server.url, patience=PATIENCE)
    try:
        server.close()
        wait_for(lambda: camera.trouble)
        last = camera.image()
        assert last is camera.image()
        server = MjpegServer(source, port=port)
        newer = wait_for(lambda: camera.image() if camera.image().time > last.time else None)
        assert camera.trouble is None
        assert exposed(newer.pixels) > exposed(last.pixels)
    finally:
        camera.close()
        server.close()


def test_a_camera_that_falls_silent_keeps_its_last_image():
    source = WallClockCamera()
    with MjpegServer(source) as server:
        camera = open_camera(server.url, patience=PATIENCE)
        source.silent = True
        last = wait_for(lambda: camera.image() if time.monotonic() - camera.image().time > 0.5 else None)
        assert exposed(last.pixels) == pytest.approx(source.newest.time)
        source.silent = False
        wait_for(lambda: camera.image().time > last.time)
        camera.close()


class HandWritten:
    """A server that answers every request with the same bytes, then with images without end, at 100 Hz."""

    def __init__(self, head, parts=()):
        self.head, self.parts, self.requests = head, parts, []
        self.listener = Listener("127.0.0.1", 0, self.serve)
        self.url = f"http://127.0.0.1:{self.listener.port}/video?x=1"

    def __enter__(self):
        return self

    def __exit__(self, *_):
        self.listener.close()

    def serve(self, line):
        self.requests.append(line.recv(4096))
        line.sendall(self.head)
        while self.parts:
            for part in self.parts:
                line.sendall(part() if callable(part) else part)
                time.sleep(0.01)


HEAD = b"HTTP/1.0 200 OK\r\nContent-Type: multipart/x-mixed-replace;boundary=--cut\r\n\r\n"


def jpeg(pixels):
    return cv2.imencode(".jpg", pixels, [cv2.IMWRITE_JPEG_QUALITY, 95])[1].tobytes()


def plain_part():
    """Return a part as simple servers write it: no length, no stamp."""
    return (
        b"--cut\r\nContent-Type: image/jpeg\r\n\r\n" + jpeg(written(round(1e3 * time.monotonic()))) + b"\r\n"
    )


def test_a_stream_written_by_hand_is_read():
    with HandWritten(HEAD, [plain_part]) as server:
        camera = open_camera(server.url, patience=PATIENCE)
        image = camera.image()
        camera.close()
        assert server.requests[0].startswith(b"GET /video?x=1 HTTP/1.1\r\n")
    assert image.time - exposed(image.pixels) > -0.002


def test_chunks_of_http_are_put_together():
    head = HEAD.replace(b"HTTP/1.0 200 OK", b"HTTP/1.1 200 OK\r\nTransfer-Encoding: chunked")

    def chunks():
        part = plain_part()
        return b"".join(b"%x\r\n%b\r\n" % (len(p), p) for p in (part[:100], part[100:]))

    with HandWritten(head, [chunks]) as server:
        camera = open_camera(server.url, patience=PATIENCE)
        assert camera.size == (640, 48)
        camera.close()


def test_a_name_and_password_are_sent_and_never_said():
    with HandWritten(b"HTTP/1.0 401 Unauthorized\r\n\r\n") as server:
        url = server.url.replace("http://", "http://me:s%20ecret@")
        with pytest.raises(InputError) as raised:
            open_camera(url, patience=PATIENCE)
        assert base64.b64encode(b"me:s ecret") in server.requests[0]
    assert str(raised.value) == f"{server.url.partition('?')[0]}: answers 401 'Unauthorized'"


def test_images_that_are_broken_are_passed_over():
    broken = b"--cut\r\nContent-Length: 9\r\n\r\n\xff\xd8 broken\r\n"
    with HandWritten(HEAD, [broken, plain_part, b"--cut\r\nContent-Length: 0\r\n\r\n\r\n"]) as server:
        camera = open_camera(server.url, patience=PATIENCE)
        assert camera.image().pixels.shape == (48, 640)
        camera.close()


@pytest.mark.slow
@pytest.mark.parametrize(
    ("head", "parts", "words"),
    [
        (b"HTTP/1.0 404 Not Found\r\n\r\n", [], "answers 404 'Not Found'"),
        (
            b"HTTP/1.0 200 OK\r\nContent-Type: text/html\r\n\r\n<html>",
            [],
            "sends text/html; MJPEG is multipart",
        ),
        (b"SSH-2.0-OpenSSH\r\n", [], "answers, but not by HTTP"),
        (HEAD, [], "no frame in 2 s: the camera closed the connection"),
        (HEAD, [30 * b"--cut\r\nContent-Length: 5\r\n\r\nabcde\r\n"], "30 images in a row that are no JPEG"),
        (HEAD, [b"--cut\r\nContent-Length: 99999999999\r\n\r\n"], "an image of 99999999999 bytes"),
        (HEAD, [bytes(20000)], "no boundary in 16384 bytes"),
    ],
)
def test_what_is_no_camera_is_one_message(head, parts, words):
    with HandWritten(head, parts) as server, pytest.raises(InputError) as raised:
        open_camera(server.url, patience=2.0)
    assert words in str(raised.value)
    assert "\n" not in str(raised.value)


def test_nobody_there_and_nobody_answering_are_one_message():
    with socket.create_server(("127.0.0.1", 0)) as silent:
        port = silent.getsockname()[1]
        with pytest.raises(InputError, match=rf"^http://127.0.0.1:{port}/: no answer$"):
            open_camera(f"http://127.0.0.1:{port}/", patience=0.3)
    with pytest.raises(InputError, match=rf"^http://127.0.0.1:{port}/: Connection refused$"):
        open_camera(f"http://127.0.0.1:{port}/", patience=5.0)


def test_jpegs_that_claim_too_many_pixels_are_not_decoded():
    content = bytearray(jpeg(written(5)))
    assert decoded(bytes(content)).shape == (48, 640)
    place = content.index(b"\xff\xc0") + 5
    content[place : place + 4] = b"\x1f\x40\x1f\x40"  # 8000 × 8000
    assert decoded(bytes(content)) is None
    assert decoded(b"") is None
    assert decoded(jpeg(written(5))[:40]) is None


@pytest.mark.parametrize("orientation", [3, 6])
def test_pixels_stay_as_they_are_stored_however_a_jpeg_says_to_turn_them(orientation):
    content, stream, exif = jpeg(written(5)), io.BytesIO(), Image.Exif()
    exif[ExifTags.Base.Orientation] = orientation
    Image.open(io.BytesIO(content)).save(stream, "JPEG", exif=exif, quality=95)
    shown = decoded(stream.getvalue())
    assert shown.shape == (48, 640)
    np.testing.assert_allclose(shown, decoded(content).astype(float), atol=30)
