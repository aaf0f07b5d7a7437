"""``omniservo render`` writes images, depth, segmentation and videos of a scene."""

import json
from pathlib import Path

import cv2
import numpy as np
import pytest
from PIL import Image
from tests.cli.calling import call
from tests.cli.test_command_line import problem, written

SCENE = Path(__file__).resolve().parents[2] / "examples/scene.xml"
FROM = "0.1,-0.9,0.5,0,0,0.1"


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    place = tmp_path_factory.mktemp("render")
    lens = {
        "format": "omniservo.camera/1", "model": "unified", "fx": 74.0, "fy": 74.0, "cx": 79.5, "cy": 59.5,
        "skew": 0.0, "xi": 1.3, "distortion": [0, 0, 0, 0], "width": 160, "height": 120, "max_angle": 1.6,
        "dead_zone": None,
    }  # fmt: skip
    written(place / "lens.json", lens)
    written(place / "problem.json", problem())
    return place


def drawn(capsys, folder, out, *more):
    code, said, err = call(
        capsys, "render", SCENE, "--camera", folder / "lens.json", "--pose", FROM, "--out", folder / out,
        "--force", "--json", *more,
    )  # fmt: skip
    assert (code, err) == (0, "")
    return json.loads(said)


def test_two_results_in_one_file_are_refused_before_anything_is_drawn(capsys, folder):
    code, said, err = call(
        capsys, "render", SCENE, "--camera", folder / "lens.json", "--pose", FROM, "--out", folder / "c.png",
        "--force", "--depth", folder / "c.npy", "--segmentation", folder / "." / "c.npy",
    )  # fmt: skip
    assert (code, said) == (2, "")
    assert "c.npy given twice; legal: a file each" in err
    assert not (folder / "c.png").exists()


def test_depth_and_segmentation_say_the_same_in_both_formats(capsys, folder):
    named = ("--depth", folder / "d.npy", "--segmentation", folder / "s.npy")
    said = drawn(capsys, folder, "a.png", *named)
    drawn(capsys, folder, "a.png", "--depth", folder / "d.png", "--segmentation", folder / "s.png")
    metres, geoms = np.load(folder / "d.npy"), np.load(folder / "s.npy")
    millimetres, numbers = (np.asarray(Image.open(folder / f"{name}.png")) for name in "ds")
    np.testing.assert_allclose(np.nan_to_num(metres), millimetres / 1e3, atol=0.6e-3)
    np.testing.assert_array_equal(geoms + 1, numbers)
    assert said["size"] == [160, 120]
    assert said["nearest_m"] == pytest.approx(np.nanmin(metres), abs=1e-6)
    assert {"floor", "ball", "can"} <= {geom["name"] for geom in said["geoms"]}
    assert {geom["geom"] for geom in said["geoms"]} == set(np.unique(geoms)) - {-1}


@pytest.mark.slow
@pytest.mark.parametrize("ending", ["gif", "mp4", "avi"])
def test_a_video_goes_along_the_path_of_a_plan(capsys, folder, ending):
    plan, video = folder / "plan.json", folder / f"way.{ending}"
    if not plan.exists():
        assert call(capsys, "plan", folder / "problem.json", "--out", plan)[0] == 0
    assert drawn(capsys, folder, video.name, "--path", plan, "--frames", "4")["frames"] == 4
    drawn(capsys, folder, "start.png")
    start = np.asarray(Image.open(folder / "start.png")).astype(int)
    if ending == "gif":
        with Image.open(video) as film:
            frames = [np.asarray(film.convert("RGB")).astype(int) for k in range(4) if not film.seek(k)]
    else:
        reader = cv2.VideoCapture(str(video))
        frames = [reader.read()[1][..., ::-1].astype(int) for _ in range(4)]
        assert not reader.read()[0]
    away = [np.abs(frame - start).mean() for frame in frames]
    assert away[0] < 8.0 < away[3]  # codecs lose a little
    assert away[0] < min(away[1:])


@pytest.mark.parametrize(
    ("changed", "words"),
    [
        ({"--pose": "1,2"}, "--pose: '1,2' given; legal: x,y,z,qx"),
        ({"--pose": "0,0,1,0,0,nan"}, "--pose: "),
        ({"--pose": "0,0,1,0,0,0"}, "do not stand above each other"),
        ({"--pose": "0,0,1,0,0,0,2"}, "a quaternion of length 2 given; legal: 1"),
        ({"--out": "a.jpg"}, "--out: a.jpg given; legal for an image: .png"),
        ({"--out": "a.png", "--path": "plan.json"}, "legal for a video: .mp4, .avi, .gif"),
        ({"--depth": "d.jpg"}, "--depth: d.jpg given; legal: a file that ends with .npy or .png"),
        ({"--camera": "fe186"}, "did you mean 'fe185'"),
    ],
)
def test_a_wrong_call_is_one_message(capsys, tmp_path, monkeypatch, changed, words):
    monkeypatch.chdir(tmp_path)
    options = {"--camera": "fe185", "--pose": FROM, "--out": "a.png"} | changed
    code, out, err = call(capsys, "render", SCENE, *(word for pair in options.items() for word in pair))
    assert (code, out) == (2, "")
    assert words in err
    assert not list(tmp_path.iterdir())
