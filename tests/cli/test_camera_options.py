"""Which camera a command means, how far its lens sees, and what a conversion may leave."""

import json

import pytest
from tests.cli.calling import call

from omniservo.camera_files import load_camera
from omniservo.cameras import PRESETS

LENS = """  camera_model: pinhole
  distortion_model: equidistant
  distortion_coeffs: [-0.0073, 0.0435, -0.0412, 0.0077]
  intrinsics: [285.4, 286.3, 416.2, 402.7]
  resolution: [848, 800]
"""


@pytest.fixture
def stereo(tmp_path):
    """Two fisheye cameras whose file describes more than their lenses see."""
    path = tmp_path / "stereo.yaml"
    path.write_text(f"cam0:\n{LENS}cam1:\n{LENS}")
    return path


@pytest.mark.slow
def test_a_converted_file_keeps_what_the_conversion_leaves(capsys, tmp_path, stereo):
    out = tmp_path / "mei.yaml"
    options = ("--to", "mei", "--camera-name", "cam0", "--largest-px", 5)
    code, said, _ = call(capsys, "camera", "convert", stereo, out, *options, "--json")
    assert code == 0
    residual = json.loads(said)["largest_px"]
    assert residual > 2.0
    direct = load_camera(stereo, name="cam0", largest_px=5.0).deviation_px
    assert load_camera(out).deviation_px == direct == json.loads(said)["deviation_px"]
    assert residual < direct < 1.002 * residual


@pytest.mark.parametrize(
    "command",
    [
        ("camera", "show", "FILE"),
        ("camera", "convert", "FILE", "OUT", "--to", "mei"),
        ("run", "paper-example-1", "--camera", "FILE", "--out", "OUT"),
        ("teach", "paper-example-1", "--camera", "FILE", "--out", "OUT"),
        ("estimate", "paper-example-1", "--camera", "FILE"),
        ("camera", "rectify", "FILE", "FILE", "OUT"),
    ],
)
def test_every_command_asks_for_a_camera_of_several_by_the_same_flag(capsys, tmp_path, stereo, command):
    places = {"FILE": stereo, "OUT": tmp_path / "out"}
    code, _, err = call(capsys, *(places.get(word, word) for word in command))
    assert (code, err.count("\n")) == (2, 1)
    assert "2 cameras; say which: --camera-name NAME, name=; name one of: cam0, cam1" in err
    named = call(capsys, *(places.get(word, word) for word in command), "--camera-name", "cam2")
    assert named[0] == 2
    assert "no camera named 'cam2'; legal: cam0, cam1" in named[2]


@pytest.mark.parametrize(
    "command",
    [
        ("camera", "convert", "FILE", "OUT", "--to", "mei"),
        ("run", "paper-example-1", "--out", "OUT", "--camera", "FILE", "--largest-px", "1"),
        ("teach", "paper-example-1", "--out", "OUT", "--camera", "FILE", "--largest-px", "1"),
        ("estimate", "paper-example-1", "--camera", "FILE", "--largest-px", "1"),
    ],
)
def test_a_refused_conversion_names_flags_that_the_command_has(capsys, tmp_path, stereo, command):
    places = {"FILE": stereo, "OUT": tmp_path / "out"}
    words = [places.get(word, word) for word in command]
    code, _, err = call(capsys, *words, "--camera-name", "cam1")
    assert (code, err.count("\n")) == (2, 1)
    assert "Its formula reaches 1" in err
    for flag in ("--max-angle", "--largest-px"):
        assert flag in err
        assert flag in call(capsys, *command[: 2 if command[0] == "camera" else 1], "--help")[1]
    assert not (tmp_path / "out").exists()


def test_a_stated_angle_makes_the_file_fit(capsys, tmp_path, stereo):
    out = tmp_path / "out.yaml"
    options = ("--camera-name", "cam0", "--max-angle", 82)
    assert call(capsys, "camera", "convert", stereo, out, "--to", "own", *options)[0] == 0
    assert load_camera(out).deviation_px < 0.3
    shown = json.loads(call(capsys, "camera", "show", stereo, *options, "--json")[1])
    assert shown["usable_angle"] == pytest.approx(82 * 3.141592653589793 / 180)
    code, _, err = call(capsys, "camera", "show", stereo, "--camera-name", "cam0", "--max-angle", 1e3)
    assert (code, err) == (2, "omniservo: --max-angle: 1000 given; legal: > 0, <= 180 (degrees)\n")


def test_presets_are_shown_by_name_and_an_unknown_one_lists_them(capsys):
    code, said, _ = call(capsys, "camera", "show", "fe185")
    assert code == 0
    assert "fx             296.9365 px\n" in said
    assert "max_angle      1.61443 rad\nusable angle   92.500 deg" in said
    assert "None" not in said
    said = call(capsys, "camera", "show", "hyper-catadioptric")[1]
    assert "\ndead_zone      center [511, 384.5], radius 46 px\n" in said
    code, _, err = call(capsys, "camera", "show", "fe186")
    legal = ", ".join(PRESETS)
    assert code == 2
    assert err == f"omniservo: camera 'fe186': neither a file nor a preset: {legal}; did you mean 'fe185'?\n"


def test_a_misspelt_format_of_cameras_is_told_with_the_one_that_was_meant(capsys, tmp_path):
    code, _, err = call(capsys, "camera", "convert", "fe185", tmp_path / "c.yaml", "--to", "kalbir")
    assert code == 2
    assert "format: 'kalbir' given; legal: own, mei, " in err
    assert err.endswith("; did you mean 'kalibr'?\n")


@pytest.mark.parametrize("option", [("--camera-name", "cam0"), ("--max-angle", 82), ("--largest-px", 2)])
def test_an_option_of_the_camera_needs_the_camera(capsys, tmp_path, option):
    code, _, err = call(capsys, "teach", "paper-example-1", "--out", tmp_path / "goal.json", *option)
    assert (code, err) == (2, f"omniservo: {option[0]}: given without --camera\n")
