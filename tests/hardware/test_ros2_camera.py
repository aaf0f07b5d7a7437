"""Images and calibrations out of ROS 2 messages, and a camera over its topic from another process."""

import os
import threading
import time
import zlib

import cv2
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from tests.hardware.served_arm import Served

from omniservo.camera_files import load_model
from omniservo.errors import ClockFault, ConnectionLost, InputError, InvalidData
from omniservo.hardware.ros2 import ros2_camera
from omniservo.hardware.ros2.image_pixels import (
    ENCODINGS,
    camera_of_info,
    grey_of_compressed,
    grey_of_image,
)
from omniservo.hardware.ros2.network import DdsNetwork
from omniservo.hardware.ros2.ros2_camera import SIGMA_OF_ARRIVAL, Ros2Camera, read_camera_info
from omniservo.hardware.ros2.server import Ros2Server
from omniservo.robots import CameraImage, CameraSource, RobotState
from omniservo.ros_messages.messages import (
    CameraInfoMessage,
    CompressedImageMessage,
    HeaderMessage,
    ImageMessage,
    JointStateMessage,
    RegionOfInterestMessage,
    TimeMessage,
)

DOMAIN = 1 + (os.getpid() + 100) % 200
HERE = DdsNetwork.localhost(DOMAIN)
PATIENCE = 30.0


def message_of(pixels, encoding, padding=0):
    rows = pixels.reshape(len(pixels), -1)
    rows = np.pad(rows, ((0, 0), (0, padding)), constant_values=255)
    height, width = pixels.shape[:2]
    return ImageMessage(HeaderMessage(), height, width, encoding, 0, rows.shape[1], rows.reshape(-1))


COLOURS = np.dstack(np.meshgrid(np.arange(0, 120, 2), np.arange(20, 220, 5), [70])).astype(np.uint8)[..., :3]
"""(40, 60, 3) BGR, smooth"""
GREY = cv2.cvtColor(COLOURS, cv2.COLOR_BGR2GRAY)
ALPHA = np.full((*GREY.shape, 1), 9, np.uint8)
SAME = {
    "mono8": GREY,
    "8UC1": GREY,
    "bgr8": COLOURS,
    "8UC3": COLOURS,
    "rgb8": COLOURS[..., ::-1],
    "bgra8": np.dstack([COLOURS, ALPHA]),
    "rgba8": np.dstack([COLOURS[..., ::-1], ALPHA]),
}


def mosaic(pattern):
    """Return the pixels of a sensor whose first rows have these colours, "rg" over "gb"."""
    channel = {"b": 0, "g": 1, "r": 2}
    raw = np.empty(GREY.shape, np.uint8)
    for k, colour in enumerate(pattern):
        part = slice(k // 2, None, 2), slice(k % 2, None, 2)
        raw[part] = COLOURS[(*part, channel[colour])]
    return raw


@pytest.mark.parametrize("padding", [0, 3])
@pytest.mark.parametrize("encoding", SAME)
def test_grey_values_of_every_order_of_colours(encoding, padding):
    assert np.array_equal(grey_of_image(message_of(SAME[encoding], encoding, padding)), GREY)


@pytest.mark.parametrize("pattern", ["rggb", "bggr", "gbrg", "grbg"])
def test_grey_values_of_mosaics(pattern):
    """Of another pattern they would be off by tens."""
    grey = grey_of_image(message_of(mosaic(pattern), f"bayer_{pattern}8"))
    assert np.abs(grey.astype(int) - GREY)[2:-2, 2:-2].max() <= 3


def test_every_legal_encoding_is_tried_here():
    assert set(ENCODINGS) == {*SAME, *(f"bayer_{p}8" for p in ("rggb", "bggr", "gbrg", "grbg"))}


def altered(**fields):
    message = message_of(GREY, "mono8")
    for name, value in fields.items():
        setattr(message, name, value)
    return message


@pytest.mark.parametrize(
    ("message", "words"),
    [
        (altered(encoding="mono16"), r"Image.encoding: 'mono16' given; legal: mono8, .*bayer_grbg8"),
        (altered(step=59), r"Image.step: 59 given; 60 pixels are 60 bytes"),
        (altered(height=41), r"Image.data: 2400 bytes; 41 rows are 2460"),
        (altered(height=39), r"Image.data: 2400 bytes; 39 rows are 2340"),
        (altered(height=0, data=np.zeros(0, np.uint8)), r"60×0 pixels; legal: 1 to"),
        (altered(width=2**32 - 1, height=2**32 - 1, step=2**32 - 1), r"pixels; legal: 1 to 50000000"),
    ],
)
def test_an_image_that_is_not_legal_is_refused_by_its_field(message, words):
    with pytest.raises(InputError, match=words):
        grey_of_image(message)


def compressed(data):
    return CompressedImageMessage(data=np.frombuffer(bytes(data), np.uint8))


@pytest.mark.parametrize("suffix", [".png", ".jpg"])
def test_compressed_images(suffix):
    data = cv2.imencode(suffix, COLOURS)[1].tobytes()
    grey = grey_of_compressed(compressed(data))
    assert np.abs(grey.astype(int) - GREY).max() <= (1 if suffix == ".png" else 12)


def test_a_mosaic_that_was_compressed_as_it_is_becomes_grey():
    message = compressed(cv2.imencode(".png", mosaic("rggb"))[1].tobytes())
    message.format = "bayer_rggb8; png compressed "
    raw = message_of(mosaic("rggb"), "bayer_rggb8")
    assert np.array_equal(grey_of_compressed(message), grey_of_image(raw))


def bomb():
    """A PNG of 60 000 × 60 000 pixels in a few bytes."""

    def chunk(name, data):
        return len(data).to_bytes(4) + name + data + zlib.crc32(name + data).to_bytes(4)

    size = (60000).to_bytes(4) * 2 + bytes([8, 0, 0, 0, 0])
    return (
        b"\x89PNG\r\n\x1a\n"
        + chunk(b"IHDR", size)
        + chunk(b"IDAT", zlib.compress(bytes(99)))
        + chunk(b"IEND", b"")
    )


@pytest.mark.parametrize(
    ("data", "words"),
    [
        (b"", "not an image; legal: JPEG, PNG"),
        (b"GIF89a" + bytes(99), "not an image; legal: JPEG, PNG"),
        (bomb(), "60000×60000 pixels; legal|not an image that can be read"),
        (cv2.imencode(".png", COLOURS)[1].tobytes()[:60], "broken|not an image"),
        (cv2.imencode(".png", 16 * GREY.astype(np.uint16))[1].tobytes(), "16 bits a pixel; legal: 8"),
        (cv2.imencode(".png", 16 * COLOURS.astype(np.uint16))[1].tobytes(), "16 bits a pixel; legal: 8"),
    ],
)
def test_a_compressed_image_that_is_not_legal_is_refused_before_it_is_decoded(data, words):
    with pytest.raises(InputError, match=f"CompressedImage.*({words})"):
        grey_of_compressed(compressed(data))


@settings(max_examples=100, deadline=None)
@given(st.data())
def test_a_compressed_image_with_wrong_bytes_is_an_image_or_refused(data):
    raw = bytearray(cv2.imencode(data.draw(st.sampled_from([".png", ".jpg"])), GREY)[1].tobytes())
    for _ in range(data.draw(st.integers(1, 8))):
        raw[data.draw(st.integers(0, len(raw) - 1))] = data.draw(st.integers(0, 255))
    try:
        grey = grey_of_compressed(compressed(raw[: data.draw(st.integers(1, len(raw)))]))
    except InputError:
        return
    assert grey.dtype == np.uint8
    assert grey.ndim == 2


K = np.array([400.0, 0.0, 320.5, 0.0, 401.0, 240.25, 0.0, 0.0, 1.0])


def info(model="plumb_bob", d=(0.1, -0.2, 0.001, 0.002, 0.05), **given):
    return CameraInfoMessage(height=480, width=640, distortion_model=model, d=np.array(d), k=K, **given)


RAYS = np.array([[0.1, -0.2, 1.0], [-0.3, 0.25, 1.0], [0.0, 0.0, 1.0]])


def test_a_calibration_is_opencvs_with_the_same_numbers():
    d = np.array([0.1, -0.2, 0.001, 0.002, 0.05])
    expected = cv2.projectPoints(RAYS, np.zeros(3), np.zeros(3), K.reshape(3, 3), d)[0][:, 0]
    assert np.allclose(camera_of_info(info()).project(RAYS)[0], expected)
    d = np.array([0.1, -0.02, 0.003, 0.001])
    expected = cv2.fisheye.projectPoints(RAYS[:, None], np.zeros(3), np.zeros(3), K.reshape(3, 3), d)[0][:, 0]
    assert np.allclose(camera_of_info(info("equidistant", d)).project(RAYS)[0], expected)


@pytest.mark.parametrize(
    ("message", "words"),
    [
        (info("thin_prism"), "sensor_msgs/msg/CameraInfo: distortion_model: .*thin_prism"),
        (CameraInfoMessage(height=480, width=640), "k: all zeros: the camera is not calibrated"),
        (info(d=(0.1,) * 3), "CameraInfo: d: "),
        (info(roi=RegionOfInterestMessage(x_offset=8)), "roi.*x_offset: a part of the sensor"),
        (info(binning_x=2), "binning_x: a binned image"),
    ],
)
def test_a_calibration_that_is_not_read_is_refused_by_its_field(message, words):
    with pytest.raises(InputError, match=words):
        camera_of_info(message)


def test_the_message_is_read_as_its_file_is(tmp_path):
    path = tmp_path / "info.yaml"
    numbers = {"k": K.tolist(), "d": [0.1, -0.2, 0.001, 0.002, 0.05]}
    path.write_text(
        f"distortion_model: plumb_bob\nwidth: 640\nheight: 480\nk: {numbers['k']}\nd: {numbers['d']}\n"
    )
    assert np.allclose(load_model(path).project(RAYS)[0], camera_of_info(info()).project(RAYS)[0])


pytest.importorskip("cyclonedds", reason="no wheel of Cyclone DDS for this platform")
from omniservo.hardware.ros2.node import RosNode  # noqa: E402


def wait_until(condition, what="it"):
    end = time.monotonic() + PATIENCE
    while not (found := condition()):
        assert time.monotonic() < end, f"{what} never came"
        time.sleep(0.002)
    return found


@pytest.mark.slow
@pytest.mark.parametrize(
    ("topic", "faults"),
    [
        ("/camera/image_raw", {"clock_offset": 5.0, "latency": 0.04, "loss": 0.1}),
        ("/camera/image_raw/compressed", {"clock_offset": -1e3, "drift_ppm": 100.0}),
    ],
)
def test_images_of_another_process_come_in_order_and_in_time(topic, faults):
    """Its k-th image has grey value k and was taken at k/30 s: stamps tell, whatever clock and line do."""
    with Served(DOMAIN, image=topic, faults=faults):
        camera = Ros2Camera(topic, network=HERE, patience=PATIENCE, clock_topic="/joint_states")
        try:
            assert isinstance(camera, CameraSource)
            assert camera.notice is None
            seen = {}
            while len(seen) < 12:
                image = wait_until(lambda: (i := camera.image()) and i.time not in seen and i, "an image")
                assert image.time <= time.monotonic()
                assert image.pixels.shape == (48, 64)
                seen[image.time] = int(image.pixels[0, 0])
            times, counts = np.array(list(seen)), np.array(list(seen.values()))
            assert (np.diff(times) > 0).all()
            assert np.allclose(np.diff(times), (np.diff(counts) % 256) / 30, atol=0.02)
        finally:
            camera.close()
            camera.close()
        with pytest.raises(ConnectionLost, match="closed"):
            camera.image()


@pytest.fixture
def node():
    made = RosNode(HERE)
    yield made
    made.close()


class Sending:
    """Sends an image each 10 ms until the end of a `with`."""

    def __init__(self, publisher, message, others=()):
        self.publisher, self.message, self.others = publisher, message, others
        self.age, self.stamped = 0.0, True
        self.ended = threading.Event()
        self.thread = threading.Thread(target=self.run, daemon=True)

    def run(self):
        while not self.ended.wait(0.01):
            now = time.monotonic()
            for other in self.others:
                other.write(JointStateMessage(HeaderMessage(TimeMessage.of(now))))
            self.message.header.stamp = TimeMessage.of(now - self.age if self.stamped else 0.0)
            self.publisher.write(self.message)

    def __enter__(self):
        self.thread.start()
        return self

    def __exit__(self, *error):
        self.ended.set()
        self.thread.join()


@pytest.mark.slow
def test_nothing_there_another_type_and_incompatible_qos_are_told_apart(node):
    with pytest.raises(ConnectionLost, match="no image in 0.3 s .*nobody publishes /camera/image_raw"):
        Ros2Camera("/camera/image_raw", network=HERE, patience=0.3)
    publisher = node.publish("/camera/image_raw", ImageMessage, reliable=False)
    with (
        Sending(publisher, message_of(GREY, "mono8")),
        pytest.raises(
            InputError, match="this program requests reliable, the publisher offers best effort, volat"
        ),
    ):
        Ros2Camera("/camera/image_raw", network=HERE, patience=1.0, reliable=True)
    _ = node.publish("/a/compressed", ImageMessage)
    with pytest.raises(
        InputError, match="/a/compressed is of sensor_msgs/msg/Image, and not of sensor_msgs/msg/Comp"
    ):
        Ros2Camera("/a/compressed", network=HERE, patience=1.0)
    with pytest.raises(ConnectionLost, match="/camera/image_raw has a publisher, and nothing arrives"):
        Ros2Camera("/camera/image_raw", network=HERE, patience=0.5)


def test_an_image_of_another_size_or_encoding_is_invalid_data_and_the_old_one_comes_back(node):
    publisher = node.publish("/camera/image_raw", ImageMessage, reliable=False)
    with Sending(publisher, message_of(GREY, "mono16")) as sending:
        with pytest.raises(InputError, match="encoding: 'mono16' given"):
            Ros2Camera("/camera/image_raw", network=HERE, patience=PATIENCE)
        sending.message = message_of(GREY, "mono8")
        camera = Ros2Camera("/camera/image_raw", network=HERE, patience=PATIENCE)
        for message, words in (
            (message_of(GREY[:20], "mono8"), "an image of 60×20 pixels; those before had 60×40"),
            (message_of(GREY, "mono16"), "encoding: 'mono16' given"),
        ):
            sending.message = message
            with pytest.raises(InvalidData, match=words):
                wait_until(lambda: camera.image() is None, "the error")
            sending.message = message_of(GREY, "mono8")
            wait_until(lambda: still_shown(camera), "an image")
        camera.close()


def test_a_broken_image_now_and_then_is_passed_over(node, monkeypatch):
    monkeypatch.setattr(ros2_camera, "PASSED_OVER", PATIENCE)  # no stall of this machine is as long
    topic, data = "/camera/image_raw/compressed", cv2.imencode(".jpg", GREY)[1].tobytes()
    publisher = node.publish(topic, CompressedImageMessage, reliable=False)
    whole, broken = compressed(data), compressed(data[: len(data) // 2])

    def send(message):
        message.header.stamp = TimeMessage.of(time.monotonic())
        publisher.write(message)

    with Sending(publisher, whole):
        camera = Ros2Camera(topic, network=HERE, patience=PATIENCE)
    shown = camera.image().time
    send(broken)
    wait_until(lambda: camera._wrong, "what is wrong")
    assert camera.image().time >= shown
    send(whole)
    wait_until(lambda: not camera._wrong and camera.image().time > shown, "the next image")
    monkeypatch.undo()
    with pytest.raises(InvalidData, match="an image that is broken"):
        wait_until(lambda: send(broken) or camera.image() is None, "the error")
    camera.close()


def still_shown(camera):
    try:
        return camera.image()
    except InvalidData:
        return None


def test_without_stamps_the_arrival_counts_and_that_is_said(node):
    publisher = node.publish("/camera/image_raw", ImageMessage, reliable=False)
    sending = Sending(publisher, message_of(GREY, "mono8"))
    sending.stamped = False
    with sending:
        camera = Ros2Camera("/camera/image_raw", network=HERE, patience=PATIENCE)
        image = camera.image()
        assert "no time stamp" in camera.notice
        assert image.time_sigma == SIGMA_OF_ARRIVAL
        assert image.time <= time.monotonic()
        camera.close()


def test_a_clock_topic_that_is_silent_is_named(node):
    publisher = node.publish("/camera/image_raw", ImageMessage, reliable=False)
    with (
        Sending(publisher, message_of(GREY, "mono8")),
        pytest.raises(ConnectionLost, match="/joint_states has no time stamps, which images"),
    ):
        Ros2Camera("/camera/image_raw", network=HERE, patience=0.5, clock_topic="/joint_states")


def test_the_clock_of_joint_states_shows_a_delay_that_every_image_has(node):
    """Images 0.3 s old at best: by their own clock they are new, by that of joint states they are not."""
    publisher = node.publish("/camera/image_raw", ImageMessage, reliable=False)
    states = node.publish("/joint_states", JointStateMessage)
    sending = Sending(publisher, message_of(GREY, "mono8"), [states])
    sending.age = 0.3
    with sending:
        camera = Ros2Camera(
            "/camera/image_raw",
            network=HERE,
            patience=PATIENCE,
            clock_topic="/joint_states",
            time_sigma=0.004,
        )
        image = wait_until(lambda: camera.image(), "an image")
        assert time.monotonic() - image.time > 0.25
        assert image.time_sigma == 0.004
        sending.age = 2.0
        with pytest.raises(ClockFault, match="by the clock of /joint_states"):
            wait_until(lambda: camera.image() is None, "the fault")
        camera.close()


def test_images_from_the_future_are_of_another_clock(node):
    """Its computer's clock is ahead of that of joint states: the stamps would all be the arrivals."""
    publisher = node.publish("/camera/image_raw", ImageMessage, reliable=False)
    states = node.publish("/joint_states", JointStateMessage)
    with Sending(publisher, message_of(GREY, "mono8"), [states]) as sending:
        camera = Ros2Camera("/camera/image_raw", network=HERE, clock_topic="/joint_states")
        sending.age = -0.3
        with pytest.raises(
            ClockFault, match=r"an image is 0\.\d+ s ahead of the clock of /joint_states: .*NTP"
        ):
            wait_until(lambda: camera.image() is None, "the fault")
        camera.close()


def test_a_publisher_that_goes_is_a_lost_connection():
    node = RosNode(HERE)
    publisher = node.publish("/camera/image_raw", ImageMessage, reliable=False)
    with Sending(publisher, message_of(GREY, "mono8")):
        camera = Ros2Camera("/camera/image_raw", network=HERE, patience=PATIENCE)
    node.close()
    with pytest.raises(ConnectionLost, match="its publisher is gone"):
        wait_until(lambda: camera.image() is None, "the end")
    camera.close()


def test_a_calibration_is_read_from_its_topic(node):
    with pytest.raises(ConnectionLost, match="no CameraInfo in 0.2 s"):
        read_camera_info("/camera/camera_info", HERE, patience=0.2)
    publisher = node.publish("/camera/camera_info", CameraInfoMessage)
    ended = threading.Event()

    def run():
        while not ended.wait(0.02):
            publisher.write(info())

    thread = threading.Thread(target=run, daemon=True)
    thread.start()
    try:
        camera = read_camera_info("/camera/camera_info", HERE, patience=PATIENCE)
        assert np.allclose(camera.project(RAYS)[0], camera_of_info(info()).project(RAYS)[0])
        with pytest.raises(InputError, match="is of sensor_msgs/msg/CameraInfo, and not"):
            Ros2Camera("/camera/camera_info", network=HERE, patience=0.5)
    finally:
        ended.set()
        thread.join()


def test_an_older_message_that_overtakes_changes_nothing(node):
    publisher = node.publish("/camera/image_raw", ImageMessage, reliable=False)
    with Sending(publisher, message_of(GREY, "mono8")) as sending:
        camera = Ros2Camera("/camera/image_raw", network=HERE, patience=PATIENCE)
        last = camera.image().time
        sending.age = 0.2
        for _ in range(20):
            image = camera.image()
            assert image.time >= last
            last = image.time
            sending.ended.wait(0.005)
        camera.close()


class Passing:
    """A camera, and the arm beside it, whose first images cannot be had."""

    calls = 0

    def read(self):
        return RobotState(time.monotonic(), np.zeros(1), np.zeros(1))

    def stop(self):
        pass

    def image(self):
        self.calls += 1
        if self.calls < 10:
            raise ConnectionLost("nobody there")
        return CameraImage(time.monotonic(), GREY)


def test_a_server_outlives_a_camera_that_fails_for_a_while():
    served = Passing()
    server = Ros2Server(served, ("joint",), served, network=HERE)
    camera = Ros2Camera("/camera/image_raw", network=HERE, patience=PATIENCE)
    assert np.array_equal(wait_until(camera.image, "an image").pixels, GREY)
    camera.close()
    server.close()
