"""Cameras from files: every real one, every format both ways, and files that are broken."""

import json

import cv2
import numpy as np
import pytest
import yaml

from omniservo.camera_files import load_camera, load_model, save_camera
from omniservo.cameras import PRESETS, UnifiedCamera, preset
from omniservo.errors import InputError

MEI = """%YAML:1.0
---
model_type: MEI
camera_name: left
image_width: 752
image_height: 480
mirror_parameters:
   xi: 1.25
distortion_parameters:
   k1: -6.5e-02
   k2: 8.0e-01
   p1: -6.0e-04
   p2: 1.5e-03
projection_parameters:
   gamma1: 1.3381845333957547e+03
   gamma2: 1340.
   u0: 378.79
   v0: 217
"""

KALIBR = """cam0:
  camera_model: omni
  distortion_coeffs: [-0.06, 0.17, 0.0007, 0.0006]
  distortion_model: radtan
  intrinsics: [1.79, 533.3, 533.2, 254.6, 256.4]
  resolution: [512, 512]
cam1:
  camera_model: omni
  distortion_coeffs: []
  distortion_model: none
  intrinsics: [1.73, 520.2, 520.1, 252.2, 254.1]
  resolution: [512, 512]
cam2:
  camera_model: fov
  distortion_coeffs: []
  distortion_model: none
  intrinsics: [0.9, 317.5, 316.2, 724.9, 546.6]
  resolution: [1440, 1080]
"""


def written(tmp_path, text, name="camera.yaml"):
    path = tmp_path / name
    path.write_text(text)
    return path


def test_mei_file_is_read(tmp_path):
    camera = load_model(written(tmp_path, MEI))
    assert camera == UnifiedCamera(
        1338.1845333957547, 1340, 378.79, 217, 1.25, 752, 480, distortion=(-0.065, 0.8, -6e-4, 1.5e-3)
    )
    assert load_model(written(tmp_path, MEI), name="left") == camera


def test_mei_camera_inside_a_larger_configuration_is_read(tmp_path):
    more = """
imu_topic: "/imu0"
extrinsicRotation: !!opencv-matrix
   rows: 3
   cols: 3
   dt: d
   data: [ 1, 0, 0, 0, 1., 0,
      0, 0, 1 ]
acc_n: 2.0e-3   # noise
"""
    assert load_camera(written(tmp_path, MEI + more)) == load_camera(written(tmp_path, MEI, "plain.yaml"))


def test_kalibr_camera_is_chosen_by_name(tmp_path):
    path = written(tmp_path, KALIBR)
    first, second = load_model(path, name="cam0"), load_model(path, name="cam1")
    assert (first.xi, first.fx, first.cy) == (1.79, 533.3, 256.4)
    assert first.distortion == (-0.06, 0.17, 0.0007, 0.0006)
    assert not second.is_distorted
    assert load_model(written(tmp_path, KALIBR[: KALIBR.index("cam1")], "one.yaml")) == first


def test_several_cameras_and_no_name_lists_the_names(tmp_path):
    with pytest.raises(InputError, match="cam0, cam1, cam2"):
        load_camera(written(tmp_path, KALIBR))
    with pytest.raises(InputError, match="'cam9'; legal: cam0, cam1, cam2"):
        load_camera(written(tmp_path, KALIBR), name="cam9")
    with pytest.raises(
        InputError, match="line 14: cam2.camera_model: 'fov' given; legal: 'omni', 'eucm', 'ds'"
    ):
        load_camera(written(tmp_path, KALIBR), name="cam2")
    with pytest.raises(InputError, match="no camera named 'right'; legal: left"):
        load_camera(written(tmp_path, MEI), name="right")


@pytest.mark.parametrize("suffix", [".json", ".yaml"])
@pytest.mark.parametrize("format_name", ["own", "mei", "camodocal", "kalibr"])
@pytest.mark.parametrize("name", [*PRESETS, "distorted"])
def test_saved_camera_loads_equal(tmp_path, format_name, name, suffix):
    distorted = UnifiedCamera(1e-5 + 3, -4.0, 1 / 3, 1e-7, 0.1, 9, 8, distortion=(1e-6, -1e-17, 1e5, 2 / 3))
    camera = PRESETS.get(name, distorted)
    path = tmp_path / f"out{suffix}"
    save_camera(camera, path, format_name)
    assert load_model(path) == camera


def test_a_camera_written_out_without_its_format_keeps_its_distortion(tmp_path):
    camera = UnifiedCamera(
        940.0, 941.0, 352.0, 229.0, 1.0, 752, 480, distortion=(-0.3, 0.2, 1e-4, 0.0), max_angle=0.87
    )
    path = tmp_path / "camera.yaml"
    path.write_text(yaml.safe_dump(json.loads(json.dumps(camera.to_dict()))))
    assert load_model(path) == camera
    path.write_text(path.read_text() + "k5: 0.1\n")
    with pytest.raises(InputError, match="k5"):
        load_camera(path)


def test_own_format_holds_skew_and_the_others_refuse_it(tmp_path):
    camera = UnifiedCamera(300, 301, 320, 240, 1.2, 640, 480, skew=0.5)
    save_camera(camera, tmp_path / "own.yaml", "own")
    assert load_model(tmp_path / "own.yaml") == camera
    for format_name in ("mei", "kalibr"):
        with pytest.raises(InputError, match="skew"):
            save_camera(camera, tmp_path / "other.yaml", format_name)
    assert not (tmp_path / "other.yaml").exists()


def test_saved_mei_file_is_read_by_opencv(tmp_path):
    camera = preset("para-catadioptric")
    save_camera(camera, tmp_path / "mei.yaml", "mei")
    storage = cv2.FileStorage(str(tmp_path / "mei.yaml"), cv2.FILE_STORAGE_READ)
    assert storage.getNode("model_type").string() == "MEI"
    assert storage.getNode("mirror_parameters").getNode("xi").real() == camera.xi
    assert storage.getNode("projection_parameters").getNode("gamma2").real() == camera.fy
    assert storage.getNode("image_width").real() == camera.width


def test_saved_kalibr_file_is_plain_yaml(tmp_path):
    save_camera(preset("fe185"), tmp_path / "chain.yaml", "kalibr")
    chain = yaml.safe_load((tmp_path / "chain.yaml").read_text())
    assert chain["cam0"]["intrinsics"] == [1.291, 296.9365, 298.4197, 316.8076, 254.9012]
    assert chain["cam0"]["resolution"] == [659, 432]


def test_existing_file_is_kept_unless_forced(tmp_path):
    path = tmp_path / "camera.json"
    save_camera(preset("fe185"), path, "own")
    with pytest.raises(InputError, match="exists"):
        save_camera(preset("perspective"), path, "own")
    save_camera(preset("perspective"), path, "own", force=True)
    assert load_model(path) == preset("perspective")
    with pytest.raises(
        InputError, match="format: 'xml' given; legal: own, mei, camodocal, kalibr, opencv, ros"
    ):
        save_camera(preset("fe185"), tmp_path / "camera.xml", "xml")


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (("xi: 1.25", "xi: -1"), "line 8: mirror_parameters.xi: -1 given; legal: >= 0"),
        (("xi: 1.25", "xi: .nan"), "line 8: mirror_parameters.xi: nan given; a finite number"),
        (("   xi: 1.25\n", ""), "line 7: mirror_parameters"),
        (("xi: 1.25", "xi: yes"), "line 8: mirror_parameters.xi: True given; a number"),
        (
            ("gamma2: 1340.", "gamma2: 0.0"),
            "line 16: projection_parameters.gamma2: 0 given; legal: any number",
        ),
        (("gamma2: 1340.", "gamma2: big"), "line 16: projection_parameters.gamma2: 'big' given"),
        (("u0: 378.79", "uo: 378.79"), "projection_parameters.u0: missing"),
        (("image_width: 752", "image_width: 0"), "line 5: image_width: 0 given; legal: >= 1"),
        (("image_width: 752", "image_width: 75.5"), "width: 75.5 given; a whole number"),
        (
            ("model_type: MEI", "model_type: SCARAMUZZA"),
            "line 3: model_type: 'SCARAMUZZA' given; legal: 'MEI', 'KANNALA",
        ),
        (("k1: -6.5e-02", "k1: -6.5e-02\n   k1: 3"), "'k1' is given twice"),
        (("model_type", "model"), "no known camera format"),
        (("   k2: 8.0e-01", "\t k2: 8.0e-01"), "line 11"),
        (("xi: 1.25", "xi: &a 1.25\n   other: *a"), "alias"),
        (("xi: 1.25", "xi: !!python/object/apply:os.getcwd []"), "line 8"),
    ],
)
def test_broken_mei_file_says_where_and_what(tmp_path, change, message):
    assert change[0] in MEI
    path = written(tmp_path, MEI.replace(*change))
    with pytest.raises(InputError) as caught:
        load_camera(path)
    assert message in str(caught.value)
    assert str(path) in str(caught.value)
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (("intrinsics: [1.79, ", "intrinsics: ["), "line 5: cam0.intrinsics: [533.3"),
        (("[1.79, 533.3", "[1.79, 0"), "line 5: cam0.intrinsics: [1]0 given; legal: any number but 0"),
        (("[1.79,", "[-1.79,"), "line 5: cam0.intrinsics: xi = -1.79 given; legal: >= 0"),
        (("-0.06, 0.17", "-0.06, .inf"), "line 3: cam0.distortion_coeffs: [1]inf given"),
        (("resolution: [512, 512]", "resolution: 512"), "line 6: cam0.resolution: 512 given; a list of 2"),
        (("resolution: [512, 512]", "size: [512, 512]"), "cam0.resolution: missing"),
        (("distortion_model: radtan", "distortion_model: equidistant"), "legal: 'radtan', 'none'"),
        (
            ("cam0:\n  camera_model: omni", "cam0: 3\nother:\n  camera_model: omni"),
            "cam0: 3 given; a mapping",
        ),
    ],
)
def test_broken_kalibr_file_says_where_and_what(tmp_path, change, message):
    assert change[0] in KALIBR
    path = written(tmp_path, KALIBR.replace(*change, 1))
    with pytest.raises(InputError) as caught:
        load_camera(path, name="cam0")
    assert message in str(caught.value)


@pytest.mark.parametrize(
    ("fields", "message"),
    [
        ({"format": "omniservo.camera/2"}, "'omniservo.camera/2' given; legal: 'omniservo.camera/1'"),
        ({"fx": None}, "fx: None given"),
        ({"focal": 3}, "focal: no such field"),
        ({"max_angle": 9}, "max_angle: 9 given"),
        ({"dead_zone": {"center": [1], "radius": 3}}, "dead_zone.center"),
    ],
)
def test_broken_own_file_says_what(tmp_path, fields, message):
    good = {"format": "omniservo.camera/1", **preset("fe185").to_dict()}
    path = written(tmp_path, json.dumps({**good, **fields}), "camera.json")
    with pytest.raises(InputError) as caught:
        load_camera(path)
    assert message in str(caught.value)


@pytest.mark.parametrize(
    "text",
    [
        "",
        "[]",
        "3",
        "hello",
        "a: [1, 2",
        "\x00",
        "cam0: " + "[" * 200,
        "- x\n" * 10,
        "{}",
        "null",
        "%YAML:1.0\n",
    ],
)
def test_text_that_is_no_camera_is_one_clear_error(tmp_path, text):
    with pytest.raises(InputError, match=r"camera\.yaml"):
        load_camera(written(tmp_path, text))


def test_bomb_large_file_folder_and_binary_are_refused(tmp_path):
    bomb = "a: &a [x, x, x, x, x, x, x, x, x]\n" + "".join(
        f"{chr(98 + i)}: &{chr(98 + i)} [{', '.join(['*' + chr(97 + i)] * 9)}]\n" for i in range(9)
    )
    with pytest.raises(InputError, match="alias"):
        load_camera(written(tmp_path, MEI + bomb))
    with pytest.raises(InputError, match="bytes"):
        load_camera(written(tmp_path, MEI + "#" * 2**20))
    with pytest.raises(InputError, match="not a file"):
        load_camera(tmp_path)
    with pytest.raises(InputError, match="no such file"):
        load_camera(tmp_path / "nothing.yaml")
    (tmp_path / "image.yaml").write_bytes(bytes(range(256)))
    with pytest.raises(InputError, match="neither text"):
        load_camera(tmp_path / "image.yaml")


@pytest.mark.parametrize("keep", [0.1, 0.3, 0.5, 0.7, 0.9])
def test_truncated_file_is_an_error_or_the_same_camera(tmp_path, keep):
    for text, name in ((MEI, None), (KALIBR[: KALIBR.index("cam1")], "cam0")):
        whole = load_camera(written(tmp_path, text, "whole.yaml"), name=name)
        cut = written(tmp_path, text[: int(keep * len(text))], "cut.yaml")
        try:
            camera = load_camera(cut, name=name)
        except InputError as error:
            assert "cut.yaml" in str(error)  # noqa: PT017
        else:
            assert camera == whole


def test_every_real_mei_file_is_read(shared_data):
    files = sorted((shared_data / "calibrations/mei_yaml").glob("*.yaml"))
    assert len(files) >= 9
    for path in files:
        if "tum_config" in path.name:  # a Kannala–Brandt camera in the same kind of file
            continue
        camera = load_camera(path)
        assert camera.is_distorted
        assert np.degrees(camera.usable_angle) > 80


def test_the_same_camera_in_two_formats_is_equal(shared_data):
    folder = shared_data / "calibrations"
    left = load_camera(folder / "mei_yaml/HKUST-Aerial-Robotics_D2SLAM__left.yaml")
    chain = folder / "kalibr/HKUST-Aerial-Robotics_D2SLAM__camchain-imucam-imucalib.yaml"
    assert load_camera(chain, name="cam0") == left


def test_a_name_that_two_cameras_of_a_file_have_is_refused(tmp_path):
    path = tmp_path / "cameras.txt"
    path.write_text("1 PINHOLE 640 480 500 500 320 240\n1 PINHOLE 640 480 900 900 320 240\n")
    with pytest.raises(InputError, match="cameras.txt: 2 cameras named '1'; legal: a name of its own each"):
        load_model(path, name="1")


OPENCV_5 = {
    "xml": """<?xml version="1.0"?>
<opencv_storage>
<image_width>640</image_width>
<image_height>480</image_height>
<camera_matrix type_id="opencv-matrix">
  <rows>3</rows>
  <cols>3</cols>
  <dt>d</dt>
  <data>
    500. 0. 320. 0. 510. 240. 0. 0. 1.</data></camera_matrix>
<distortion_coefficients type_id="opencv-nd-matrix">
  <sizes>
    5</sizes>
  <dt>d</dt>
  <data>
    0.1 -0.2 0.001 0.002
    0.05</data></distortion_coefficients>
</opencv_storage>
""",
    "yaml": """%YAML 1.2
---
image_width: 640
image_height: 480
camera_matrix: !!opencv-matrix
   rows: 3
   cols: 3
   dt: d
   data: [ 500., 0., 320., 0., 510., 240., 0., 0., 1. ]
distortion_coefficients: !!opencv-nd-matrix
   sizes: [ 5 ]
   dt: d
   data: [ 0.1, -0.2, 0.001,
       0.002, 0.05 ]
""",
}
OPENCV_5["json"] = json.dumps(
    {
        "image_width": 640,
        "image_height": 480,
        "camera_matrix": {
            "type_id": "opencv-matrix",
            "rows": 3,
            "cols": 3,
            "dt": "d",
            "data": [500.0, 0.0, 320.0, 0.0, 510.0, 240.0, 0.0, 0.0, 1.0],
        },
        "distortion_coefficients": {
            "type_id": "opencv-nd-matrix",
            "sizes": [5],
            "dt": "d",
            "data": [0.1, -0.2, 0.001, 0.002, 0.05],
        },
    },
    indent=4,
)


@pytest.mark.parametrize("suffix", OPENCV_5)
def test_arrays_of_one_dimension_as_opencv_5_writes_them_are_read(tmp_path, suffix):
    camera = load_model(written(tmp_path, OPENCV_5[suffix], f"camera.{suffix}"))
    assert (camera.fx, camera.fy, camera.cx, camera.cy) == (500.0, 510.0, 320.0, 240.0)
    assert camera.distortion == (0.1, -0.2, 0.001, 0.002, 0.05)


@pytest.mark.parametrize(
    ("sizes", "message"),
    [
        ("[ 4 ]", "5 numbers given; 4 are needed"),
        ("[ 5, 2 ]", "5 numbers given; 5 x 2 are needed"),
        ("[ -5 ]", "sizes: [0]-5 given"),
        ("[ x ]", "sizes: [0]'x' given"),
        ("{ a: 5 }", "sizes: [0]{'a': 5} given"),
    ],
)
def test_sizes_that_are_none_of_the_data_are_refused(tmp_path, sizes, message):
    text = OPENCV_5["yaml"].replace("[ 5 ]", sizes)
    with pytest.raises(InputError, match="distortion_coefficients") as caught:
        load_model(written(tmp_path, text))
    assert message in str(caught.value)
