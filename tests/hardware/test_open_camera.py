"""Cameras by their URI: folders, videos, streams by OpenCV, and what there is not."""

import subprocess
import sys
import time

import cv2
import numpy as np
import pytest
from tests.hardware.wall_clock_arm import PATIENCE, wait_for
from tests.hardware.wall_clock_camera import WallClockCamera, exposed, written

from omniservo.errors import InputError
from omniservo.hardware.camera_sources import NewestFrame, open_camera
from omniservo.hardware.camera_sources.frame_reader import UnlikeFrame
from omniservo.hardware.camera_sources.mjpeg_server import MjpegServer
from omniservo.hardware.camera_sources.opencv_reader import OpencvReader, grey


@pytest.fixture
def folder(tmp_path):
    cv2.imwrite(str(tmp_path / "0.png"), written(9))
    images = tmp_path / "images"
    images.mkdir()
    for k in range(5):
        cv2.imwrite(str(images / f"{k}.png"), written(k))
    return images


def numbers_and_times(camera, last):
    """Return what the images of a source carry, and their times, until the last one."""
    found = {}

    def is_over():
        image = camera.image()
        found[round(1e3 * exposed(image.pixels))] = image.time
        return last in found

    wait_for(is_over)
    return found


def test_a_folder_with_a_rate_comes_in_the_order_of_names(folder):
    begin = time.monotonic()
    camera = open_camera(f"folder:{folder}?rate=20")
    found = numbers_and_times(camera, 4)
    end = time.monotonic()
    camera.close()
    assert camera.notice is None
    assert found[4] - found[min(found)] == pytest.approx((4 - min(found)) / 20.0)
    assert begin <= min(found.values())
    assert found[4] <= end
    assert camera.image().time_sigma == 0.0


def test_a_folders_stamps_count(folder):
    (folder / "stamps.txt").write_text("# name, seconds\n3.png 7.0\n\n0.png 7.25  # later\n1.png 7.3\n")
    camera = open_camera(f"folder:{folder}")
    found = numbers_and_times(camera, 1)
    camera.close()
    assert set(found) <= {3, 0, 1}
    for number, stamp in ((3, 7.0), (0, 7.25)):
        if number in found:
            assert found[1] - found[number] == pytest.approx(7.3 - stamp)


def test_stamps_that_an_editor_marked_as_utf_8_count(folder):
    (folder / "stamps.txt").write_text("3.png 7.0\n0.png 7.25\n", encoding="utf-8-sig")
    camera = open_camera(f"folder:{folder}")
    assert camera.image().pixels.shape == (48, 640)
    camera.close()


def test_a_device_that_is_no_camera_is_one_message_and_opencv_writes_none(capfd):
    with pytest.raises(InputError, match="^/dev/null: cannot be opened"):
        open_camera("/dev/null")
    assert capfd.readouterr() == ("", "")


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("0.png 1\n1.png\n", r"stamps.txt:2: legal is NAME SECONDS"),
        ("0.png nan\n", r"stamps.txt:1: legal is NAME SECONDS"),
        ("0.png 1\n1.png 1\n", r"stamps.txt:2: 1 s is no later than the line before"),
        ("nope.png 1\n", r"stamps.txt:1: no image of this name"),
        ("../0.png 1\n", r"stamps.txt:1: no image of this name"),
        ("# nothing\n", r"no image in it"),
    ],
)
def test_a_wrong_line_of_the_stamps_is_named(folder, text, words):
    (folder / "stamps.txt").write_text(text)
    with pytest.raises(InputError, match=words):
        open_camera(f"folder:{folder}")


def test_what_is_no_image_in_a_folder_is_refused(folder):
    (folder / "0.png").write_bytes(b"no image")
    with pytest.raises(InputError, match=r"0\.png: not an image"):
        open_camera(f"folder:{folder}?rate=10")


def test_a_video_file_comes_at_its_own_rate(tmp_path):
    path = tmp_path / "film.avi"
    writer = cv2.VideoWriter(str(path), cv2.VideoWriter_fourcc(*"MJPG"), 10.0, (640, 48))
    for k in range(5):
        writer.write(cv2.cvtColor(written(k), cv2.COLOR_GRAY2BGR))
    writer.release()
    camera = open_camera(str(path))
    found = numbers_and_times(camera, 4)
    camera.close()
    first = min(found)
    assert first < 4
    assert found[4] - found[first] == pytest.approx((4 - first) / 10.0)
    assert camera.trouble is None


@pytest.mark.slow
def test_a_live_stream_by_opencv_is_read_and_says_what_its_stamps_are():
    with MjpegServer(WallClockCamera(60.0)) as server:
        camera = NewestFrame("stream", lambda: OpencvReader(server.url, PATIENCE), patience=PATIENCE)
        try:
            first = camera.image()
            assert first.pixels.shape == (48, 640)
            assert first.time - exposed(first.pixels) > -0.005
            assert camera.notice
            wait_for(lambda: exposed(camera.image().pixels) > exposed(first.pixels))
        finally:
            camera.close()


@pytest.mark.parametrize(
    ("uri", "words"),
    [
        ("v4l2:77", "^v4l2:77: there is no /dev/video77$"),
        (77, "^77: there is no /dev/video77$"),
        ("/dev/video77", "^/dev/video77: there is no /dev/video77$"),
        ("rtsp://me:secret@127.0.0.1:1/x", "^rtsp://127.0.0.1:1/x: cannot be opened"),
        ("film.mp4", "'film.mp4': no such file; legal: v4l2:0"),
        ("ftp://x", "'ftp://x': legal: v4l2:0"),
        ("http:///x", "legal: v4l2:0"),
        ("http://x:port/", "Port could not be cast"),
        ("", "legal: v4l2:0"),
        ("folder:", "legal: v4l2:0"),
        ("folder:nowhere", "^nowhere: no such folder$"),
        ("folder:.?rate=0", "rate is images per second"),
        ("folder:.?rate=fast", "rate is images per second"),
    ],
)
def test_what_there_is_not_is_one_message(uri, words, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    with pytest.raises(InputError, match=words):
        open_camera(uri, patience=2.0)


@pytest.mark.slow
def test_opencv_and_ffmpeg_write_nothing_about_a_stream_that_is_not_there():
    script = """
from omniservo.errors import InputError
from omniservo.hardware.camera_sources import open_camera
try:
    open_camera("rtsp://127.0.0.1:1/x", patience=2.0)
except InputError as error:
    print(error)
"""
    done = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True, check=True)
    assert (done.stdout[:40], done.stderr) == ("rtsp://127.0.0.1:1/x: cannot be opened: ", "")


def test_a_folder_without_images_or_stamps_and_a_file_that_is_no_video_are_refused(tmp_path):
    with pytest.raises(InputError, match=r"no stamps\.txt .* or state a rate: folder:.*\?rate=30"):
        open_camera(f"folder:{tmp_path}")
    with pytest.raises(InputError, match="no image in it"):
        open_camera(f"folder:{tmp_path}?rate=30")
    (tmp_path / "text.mp4").write_text("no video")
    with pytest.raises(InputError, match="not a video that OpenCV reads"):
        open_camera(str(tmp_path / "text.mp4"))


@pytest.mark.parametrize("pixels", [np.zeros((4, 4), np.uint16), np.zeros((4,), np.uint8)])
def test_frames_of_another_form_are_refused(pixels):
    with pytest.raises(UnlikeFrame, match="8 bits"):
        grey(pixels)


def test_colours_become_grey():
    assert grey(np.full((2, 3, 3), 200, np.uint8)).tolist() == [[200] * 3] * 2
    assert grey(np.full((2, 3, 1), 200, np.uint8)).tolist() == [[200] * 3] * 2
    assert grey(np.full((2, 3), 200, np.uint8)).tolist() == [[200] * 3] * 2
