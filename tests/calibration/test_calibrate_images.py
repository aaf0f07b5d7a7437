"""From pictures of a board to a camera, a file and a report: the whole chain on rendered pictures."""

import math
from dataclasses import replace

import numpy as np
import pytest
from PIL import Image
from tests.calibration.rendered_boards import facing, render
from tests.cli.valid_output import check_output

from omniservo.calibration import board_from_text, calibrate_images
from omniservo.camera_files import load_camera
from omniservo.cameras import preset
from omniservo.cli.calibrate import _lines
from omniservo.cli.main import main
from omniservo.errors import InputError, NoSolutionError
from omniservo.reporting.calibration_report import calibration_html

BOARD = "checkerboard:8x5:0.03"
VIEWS = [  # direction of the board's middle, distance, lean, roll
    ((0.0, 0.0, 1.0), 0.15, (0.3, -0.2), 0.4),
    ((0.5, 0.2, 1.0), 0.16, (-0.3, 0.2), 1.0),
    ((-0.6, 0.1, 0.8), 0.16, (0.2, 0.4), 0.0),
    ((0.1, -0.7, 0.8), 0.17, (0.4, 0.1), 2.0),
    ((1.0, 0.1, 0.6), 0.2, (0.2, 0.1), 0.4),
    ((-1.0, -0.1, 0.5), 0.2, (-0.2, -0.3), -0.5),
    ((0.0, 0.5, 1.0), 0.16, (-0.4, -0.2), 1.6),
]


@pytest.fixture(scope="module")
def pictures(tmp_path_factory):
    """Seven views of a board through the paper's fisheye, and one picture without a board."""
    folder, camera, board = tmp_path_factory.mktemp("pictures"), preset("fe185"), board_from_text(BOARD)
    files = []
    for k, (direction, distance, lean, roll) in enumerate(VIEWS):
        image = render(camera, board, facing(board, direction, distance, lean, roll), seed=k)
        files.append(folder / f"view{k}.png")
        Image.fromarray(image).save(files[-1])
    files.append(folder / "empty.png")
    Image.fromarray(np.full((camera.height, camera.width), 128, dtype=np.uint8)).save(files[-1])
    return files


@pytest.fixture(scope="module")
def calibrated(pictures):
    return calibrate_images(pictures, board_from_text(BOARD))


@pytest.mark.slow
def test_a_copy_of_an_image_makes_the_result_no_surer(pictures, calibrated, tmp_path):
    copy = tmp_path / "again.png"
    copy.write_bytes(pictures[1].read_bytes())
    doubled = calibrate_images([*pictures, copy, pictures[0]], board_from_text(BOARD))
    assert doubled.camera.to_dict() == calibrated.camera.to_dict()
    reasons = doubled.not_used()
    assert reasons[len(pictures)] == f"a copy of {pictures[1]}"
    assert reasons[len(pictures) + 1] == f"a copy of {pictures[0]}"


def test_a_folder_or_a_video_in_the_place_of_images_is_told_what_to_give(tmp_path):
    with pytest.raises(InputError, match=r"a folder; legal: images, as in .*/\*\.png"):
        calibrate_images([tmp_path], board_from_text(BOARD))
    (tmp_path / "take.MP4").write_bytes(bytes(100))
    with pytest.raises(InputError, match="not an image; .*calibrate takes the images with --camera-source"):
        calibrate_images([tmp_path / "take.MP4"], board_from_text(BOARD))


def test_camera_sees_what_the_true_one_sees(calibrated):
    found, true = calibrated.camera, preset("fe185")
    assert calibrated.calibration.status == "ok"
    assert calibrated.calibration.rms_px < 0.1
    angles, turns = np.meshgrid(np.linspace(0.05, 1.3, 12), np.linspace(0.0, 2 * math.pi, 24))
    rays = np.stack([np.sin(angles) * np.cos(turns), np.sin(angles) * np.sin(turns), np.cos(angles)], axis=-1)
    pixels, seen = found.project(rays)
    assert seen.all()
    off = np.linalg.norm(pixels - true.project(rays)[0], axis=-1)
    assert off.max() < found.deviation_px < 3.0
    assert found.xi == pytest.approx(true.xi, rel=0.05)


def test_every_image_is_used_or_named(calibrated, pictures):
    assert set(calibrated.not_used()) == {7}
    assert set(calibrated.calibrated) == set(range(7))
    assert calibrated.size == (659, 432)


def test_a_mirror_has_one_negative_focal_length(calibrated):
    mirrored = replace(calibrated, mirrored=True)
    assert not calibrated.mirrored
    assert mirrored.camera.fy == -calibrated.camera.fy
    assert mirrored.camera.fx == calibrated.camera.fx
    assert "mirror" in calibration_html(mirrored)
    assert any("fy (and p1) of the file have the opposite sign" in line for line in _lines(mirrored))


@pytest.mark.slow
def test_boards_with_names_tell_a_mirror_by_themselves(tmp_path):
    true, board = preset("hyper-catadioptric"), board_from_text("charuco:7x5:0.035:0.026:DICT_4X4_50")
    files = []
    for k, turn in enumerate(np.radians([0.0, 75.0, 150.0, 220.0, 290.0])):
        pose = facing(board, (math.cos(turn), math.sin(turn), 0.3), 0.2, (0.4 * (-1) ** k, 0.3), turn)
        files.append(tmp_path / f"{k}.png")
        Image.fromarray(render(true, board, pose, seed=k)).save(files[-1])
    found = calibrate_images(files, board)
    assert found.mirrored
    assert found.camera.fy < 0.0 < found.camera.fx
    # the preset's fx is negative instead: the same camera turned by half a turn about its axis
    rays = np.array([[0.9, 0.2, 0.3], [-0.4, 0.8, 0.5], [0.1, -0.9, 0.1]])
    turned = rays * [-1.0, -1.0, 1.0]
    assert np.abs(found.camera.project(turned)[0] - true.project(rays)[0]).max() < 1.0


def test_report_tells_every_image_and_shows_every_figure(calibrated):
    text = calibration_html(calibrated)
    assert "Calibrated" in text
    assert text.count("<img ") == 7
    assert all(f"view{k}.png" in text for k in range(7))
    assert "empty.png" in text
    assert "<script" not in text
    assert "nan" not in text.split("base64")[0].lower()


@pytest.mark.slow
def test_command_writes_camera_and_report(pictures, tmp_path, capsys):
    out, report = tmp_path / "camera.yaml", tmp_path / "report.html"
    options = ["--board", BOARD, "--mirror", "--out", str(out), "--report", str(report), "--json"]
    with pytest.raises(SystemExit) as end:
        main(["camera", "calibrate", *map(str, pictures), *options])
    assert not end.value.code
    said = check_output(capsys.readouterr().out)
    assert said["status"] == "ok"
    assert list(said["not_used"]) == [str(pictures[7])]
    assert load_camera(out).to_dict() == said["camera"]
    assert said["camera"]["fy"] < 0.0
    assert said["covariance"] == said["camera"]["calibration_covariance"]
    assert len(said["covariance"]) == len(said["parameters"])
    assert report.stat().st_size > 100_000


def refused(arguments, capsys):
    with pytest.raises(SystemExit) as end:
        main(arguments)
    return end.value.code, capsys.readouterr().err


def test_a_board_that_is_in_no_image_is_an_answer(pictures, tmp_path, capsys):
    out = tmp_path / "camera.yaml"
    code, said = refused(
        ["camera", "calibrate", str(pictures[7]), "--board", BOARD, "--out", str(out)], capsys
    )
    assert code == 1
    assert "the board is in none of the 1 images" in said
    assert not out.exists()


def test_too_few_views_are_an_answer_and_write_no_camera(pictures, tmp_path, capsys):
    out = tmp_path / "camera.yaml"
    code, said = refused(
        ["camera", "calibrate", *map(str, pictures[:2]), "--board", BOARD, "--out", str(out)], capsys
    )
    assert code == 1
    assert "view" in said
    assert not out.exists()


@pytest.mark.parametrize(
    ("change", "named"),
    [
        ({"image": "other size"}, "other images have 659×432"),
        ({"image": "no image"}, "not an image; legal"),
        ({"image": "missing"}, "no such file"),
        ({"board": "checkerboard:8x5"}, "checkerboard"),
        ({"board": "carpet:8x5:0.03"}, "carpet"),
    ],
)
def test_wrong_input_is_one_message(change, named, pictures, tmp_path, capsys):
    files = list(map(str, pictures[:3]))
    bad = tmp_path / "bad.png"
    if change.get("image") == "other size":
        Image.fromarray(np.zeros((100, 120), dtype=np.uint8)).save(bad)
    elif change.get("image") == "no image":
        bad.write_text("picture")
    if "image" in change:
        files.append(str(bad))
    code, said = refused(["camera", "calibrate", *files, "--board", change.get("board", BOARD)], capsys)
    assert code == 2
    assert named in said
    assert said.count("\n") == 1


def test_results_are_not_overwritten(pictures, tmp_path, capsys):
    out = tmp_path / "camera.yaml"
    out.write_text("mine")
    code, _ = refused(["camera", "calibrate", str(pictures[0]), "--board", BOARD, "--out", str(out)], capsys)
    assert code == 2
    assert out.read_text() == "mine"


def test_none_and_too_many_images_are_refused(pictures):
    with pytest.raises(InputError, match="images: 0 given"):
        calibrate_images([], board_from_text(BOARD))
    with pytest.raises(NoSolutionError):
        calibrate_images(pictures[7:], board_from_text(BOARD))
