"""`camera calibrate --camera-source`: images taken live calibrate as the same images do as files."""

import json
import os
import signal
import sys
import time

import numpy as np
import pytest
from PIL import Image
from tests.calibration.rendered_boards import facing, render
from tests.calibration.test_calibrate_images import BOARD, VIEWS

from omniservo.calibration import board_from_text, find_board
from omniservo.camera_files import load_camera
from omniservo.cameras import preset
from omniservo.cli.main import main
from omniservo.robots import CameraImage
from omniservo.runs.watch_camera import BoardViews, watch_camera

TIMES = 12
"""each view is shown, one image after the other"""


@pytest.fixture(scope="module")
def images():
    """Five views of a board through the paper's fisheye."""
    camera, board = preset("fe185"), board_from_text(BOARD)
    return [render(camera, board, facing(board, *view), seed=k) for k, view in enumerate(VIEWS[:5])]


@pytest.fixture(scope="module")
def source(images, tmp_path_factory):
    """A folder in which each view stands for as long as this machine needs to see it several times."""
    folder, board = tmp_path_factory.mktemp("source"), board_from_text(BOARD)
    find_board(images[0], board)
    begin = time.perf_counter()
    find_board(images[0], board)
    dwell = max(0.6, 10.0 * (time.perf_counter() - begin))
    for k, image in enumerate(images):
        first = folder / f"{k}-00.png"
        Image.fromarray(image).save(first)
        for again in range(1, TIMES):
            os.link(first, folder / f"{k}-{again:02d}.png")
    return f"folder:{folder}?rate={TIMES / dwell:.3f}"


class Shown:
    """A camera whose next image is there at once."""

    def __init__(self, *images, at_end=lambda: None):
        self._images, self._next, self._at_end = images, 0, at_end

    def image(self):
        if self._next == len(self._images):
            self._at_end()
            return CameraImage(float(self._next), self._images[-1])
        self._next += 1
        return CameraImage(float(self._next), self._images[self._next - 1])

    def close(self):
        pass


def run(arguments, capsys):
    try:
        main(["camera", "calibrate", "--board", BOARD, *map(str, arguments)])
        code = 0
    except SystemExit as end:
        code = end.code or 0
    return code, capsys.readouterr()


@pytest.mark.slow
def test_live_calibrates_as_the_kept_images_do(source, images, tmp_path, capsys):
    live, again = tmp_path / "camera.yaml", tmp_path / "again.yaml"
    code, said = run(["--camera-source", source, "--out", live], capsys)
    assert code == 0, said.err
    kept = sorted((tmp_path / "camera-images").iterdir())
    assert 3 <= len(kept) <= len(images)
    shown = [np.asarray(Image.open(path)) for path in kept]
    assert all(any(np.array_equal(image, known) for known in images) for image in shown)
    assert "the source has no more images" in said.out
    assert "still missing: the board in the" in said.out
    assert "hold it still" in said.err
    assert "missing: the board in the" in said.err
    assert "\x1b" not in said.err
    code, _ = run([*kept, "--out", again], capsys)
    assert code == 0
    assert live.read_bytes() == again.read_bytes()


def watched(camera, **options):
    return watch_camera(camera, BoardViews(board_from_text(BOARD)), **options)


@pytest.mark.slow
def test_each_view_is_kept_once_however_often_it_is_shown(images):
    stopped = []
    shown = Shown(*(image for image in images for _ in range(4)), at_end=lambda: stopped.append(True))
    watch = watched(shown, stopped=lambda: bool(stopped))
    assert watch.looked_at == 4 * len(images)
    assert len(watch.images) == len(images)
    assert all(np.array_equal(kept, image) for kept, image in zip(watch.images, images, strict=True))
    assert watch.ended == "stopped"


def test_a_view_shown_once_does_not_stand_still(images):
    stopped = []
    watch = watched(Shown(*images, at_end=lambda: stopped.append(True)), stopped=lambda: bool(stopped))
    assert watch.looked_at == len(images)
    assert watch.images == []


def test_it_ends_when_nothing_is_missing(images, monkeypatch):
    from omniservo.calibration.view_choice import ViewChoice

    monkeypatch.setattr(ViewChoice, "missing", lambda self: () if len(self.kept) == 2 else ("another view",))
    watch = watched(Shown(*(image for image in images for _ in range(2))))
    assert (watch.ended, len(watch.images)) == ("nothing is missing", 2)


def test_images_of_another_size_end_it_with_what_there_is(images):
    watch = watched(Shown(images[0], images[0], images[1][:-2]))
    assert len(watch.images) == 1
    assert "659×430" in watch.ended


def test_too_few_views_are_a_message_and_no_file(source, tmp_path, capsys):
    out = tmp_path / "camera.yaml"
    code, said = run(["--camera-source", source, "--out", out, "--seconds", "0"], capsys)
    assert code == 1
    assert "0 s are over: 0 of 0 images kept, at least 3 are needed; nothing was written" in said.err
    assert "the board in the lower left corner" in said.err
    assert list(tmp_path.iterdir()) == []


def interrupted(monkeypatch, images):
    """Have the command see a camera that shows images, and then a Ctrl-C."""
    ends = []

    def end():
        if not ends:
            ends.append(True)
            signal.raise_signal(signal.SIGINT)

    shown = Shown(*(image for image in images for _ in range(2)), at_end=end)
    monkeypatch.setattr("omniservo.runs.open_hardware.camera_at", lambda uri: shown)


@pytest.mark.slow
def test_ctrl_c_calibrates_with_what_there_is(images, monkeypatch, tmp_path, capsys):
    interrupted(monkeypatch, images)
    usual, out = signal.getsignal(signal.SIGINT), tmp_path / "camera.yaml"
    options = ["--camera-source", "0", "--out", out, "--save", tmp_path / "kept", "--json"]
    code, said = run(options, capsys)
    assert code == 0, said.err
    assert load_camera(out).to_dict() == json.loads(said.out)["camera"]
    assert len(list((tmp_path / "kept").iterdir())) == len(images)
    assert said.err == ""
    assert signal.getsignal(signal.SIGINT) is usual


def test_ctrl_c_with_too_few_views_writes_nothing(images, monkeypatch, tmp_path, capsys):
    interrupted(monkeypatch, images[:2])
    code, said = run(["--camera-source", "0", "--out", tmp_path / "camera.yaml"], capsys)
    assert code == 1
    assert "stopped: 2 of 4 images kept, at least 3 are needed; nothing was written" in said.err
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize(
    ("arguments", "named"),
    [
        ([], "give image files or --camera-source"),
        (["a.png", "--camera-source", "0"], "give image files or --camera-source"),
        (["--camera-source", "0"], "live images: give --out or --save"),
        (["a.png", "--save", "kept"], "--save: goes with --camera-source"),
        (["--camera-source", "folder:nowhere?rate=3", "--save", "kept"], "nowhere: no such folder"),
    ],
)
def test_a_wrong_call_is_one_message(arguments, named, tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    code, said = run(arguments, capsys)
    assert code == 2
    assert named in said.err
    assert list(tmp_path.iterdir()) == []


def test_a_folder_that_is_there_is_kept(source, tmp_path, capsys):
    (tmp_path / "camera-images").mkdir()
    code, said = run(["--camera-source", source, "--out", tmp_path / "camera.yaml"], capsys)
    assert code == 2
    assert "camera-images: exists" in said.err


@pytest.mark.slow
def test_a_terminal_shows_a_block_that_changes(images, monkeypatch, tmp_path, capsys):
    interrupted(monkeypatch, images)
    monkeypatch.setattr(sys.stderr, "isatty", lambda: True)
    monkeypatch.setenv("TERM", "xterm")
    code, said = run(["--camera-source", "0", "--out", tmp_path / "camera.yaml"], capsys)
    assert code == 0, said.err
    assert "\x1b[" in said.err
    assert "kept: another place, size or tilt" in said.err
