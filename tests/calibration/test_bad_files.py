"""Files that are broken, hostile, or of another kind: one line that says where, and nothing else happens."""

import json
import time

import numpy as np
import pytest
import yaml
from tests.calibration.format_samples import K_DATA, SAMPLES

from omniservo.camera_files import load_model, save_camera
from omniservo.cameras.models import KannalaBrandt, Pinhole
from omniservo.errors import InputError

K_ROWS = [[300.0, 0.0, 320.0], [0.0, 300.0, 240.0], [0.0, 0.0, 1.0]]
RADTAN = [-0.2, 0.05, 0.001, -0.002, 0.01]


def refusal(tmp_path, text, **options):
    """The message of a file that must be refused: one line that begins with the file's name."""
    path = tmp_path / "camera.dat"
    path.write_text(text)
    with pytest.raises(InputError) as caught:
        load_model(path, **options)
    message = str(caught.value)
    assert "\n" not in message
    assert message.startswith(str(path))
    assert len(message) < 1200
    return message.removeprefix(f"{path}: ")


CHANGES = [
    (
        "OpenCV omnidir, XML, xi a number",
        ("<xi>1.125</xi>", "<xi>-1</xi>"),
        "line 11: opencv_storage.xi: -1 given",
    ),
    ("OpenCV omnidir, XML, xi a number", ("<xi>1.125</xi>", "<xi>.Nan</xi>"), "opencv_storage.xi: nan given"),
    ("OpenCV omnidir, XML, xi a number", ("6.105e+02 0.", "0. 0."), "camera_matrix: a focal length of 0"),
    ("OpenCV omnidir, XML, xi a number", ("479. 0. 0. 1.", "479. 0. 0. 2."), "legal: [fx, skew, cx; 0, fy, "),
    (
        "OpenCV omnidir, XML, xi a number",
        ("<cols>3</cols>", "<cols>4</cols>"),
        "9 numbers given; 3 x 4 are needed",
    ),
    (
        "OpenCV omnidir, XML, xi a number",
        ("<dt>d</dt>", "<dt>run()</dt>"),
        "'run()' given; legal: as in OpenCV",
    ),
    (
        "OpenCV omnidir, XML, xi a number",
        ("<dt>d</dt>", f"<dt>{5000 * '1'}d</dt>"),
        "given; legal: as in OpenCV",
    ),
    (
        "OpenCV omnidir, XML, xi a number",
        ("-0.2 6.0", "-0.2 x 6.0"),
        "line 9: opencv_storage.distortion_coefficients.data: 1 numbers given",
    ),
    (
        "OpenCV omnidir, XML, xi a number",
        ("<cols>4</cols>", "<cols>5</cols>"),
        "4 numbers given; 1 x 5 are needed",
    ),
    ("OpenCV omnidir, XML, xi a number", ("</opencv_storage>", ""), "not XML: no element found"),
    (
        "OpenCV omnidir, XML, xi a number",
        ("<image_width>1280</image_width>", ""),
        "does not say the image size",
    ),
    (
        "OpenCV pinhole, five",
        ("rows: 5", "rows: 6"),
        "line 14: distortion_coefficients.data: 5 numbers given",
    ),
    ("OpenCV, four numbers, the caller says pinhole", ("", ""), "say it: --model pinhole or --model fisheye"),
    (
        "Kalibr ds",
        ("camera_model: ds", "camera_model: fov"),
        "line 2: cam0.camera_model: 'fov' given; legal: 'omni'",
    ),
    ("Kalibr ds", ("distortion_model: none", "distortion_model: fov"), "'fov' given; legal: 'none'"),
    ("Kalibr ds", ("-0.2, 0.6, 317.5", "-0.2, 0.6, 0"), "line 3: cam0.intrinsics: [2]0 given"),
    ("Kalibr eucm", ("0.63, 1.04", "1.63, 1.04"), "cam0: alpha: 1.63 given"),
    ("CamOdoCal KANNALA_BRANDT", ("k4: 0.003", "k4: .inf"), "projection_parameters.k4: inf given"),
    ("CamOdoCal KANNALA_BRANDT", ("  k5: -0.0004\n", ""), "projection_parameters.k5: missing"),
    ("Basalt kb4", ('"kb4"', '"fov"'), "value0.intrinsics[1].camera_type: 'fov' given; legal: 'pinhole'"),
    ("Basalt kb4", ('"fx": 311.0', '"fx": 0'), "line 1: value0.intrinsics[1].intrinsics.fx: 0 given"),
    ("Basalt ucm", ('"alpha": 0.5}}]', '"alpha": 1}}]'), "alpha: 1 given; legal: >= 0 and < 1"),
    ("Basalt ds", ("[640, 480]]", "640]"), "value0.resolution[1]: 640 given; a list of 2 numbers"),
    (
        "ROS plumb_bob",
        ("plumb_bob", "plumb"),
        "line 8: distortion_model: 'plumb' given; legal: 'plumb_bob'",
    ),
    ("ROS plumb_bob", ("611., 0., 320.25", "0., 0., 320.25"), "line 4: camera_matrix: a focal length of 0"),
    ("ROS equidistant", (", -0.0004]", "]"), "line 12: distortion_coefficients.data: 3 numbers given; 1 x 4"),
    (
        "ORB-SLAM3, the first of a stereo fisheye",
        ('"KannalaBrandt8"', '"Fisheye"'),
        "line 5: Camera.type: 'Fisheye' given; legal: 'PinHole', 'KannalaBrandt8', 'Rectified'",
    ),
    ("ORB-SLAM3, the first of a stereo fisheye", ("Camera1.k2: -0.02\n", ""), "Camera1.k2: missing"),
    (
        "stella_vslam, fisheye",
        ('"fisheye"', '"equirectangular"'),
        "line 6: Camera.model: 'equirectangular' given; legal: 'perspective', 'fisheye'",
    ),
    ("OpenVSLAM, perspective", ("Camera.k3: 0.02\n", ""), "Camera.k3: missing"),
    (
        "OKVIS, equidistant",
        ("equidistant", "fov"),
        "cameras[0].distortion_type: 'fov' given; legal: 'radialt",
    ),
    (
        "OKVIS, equidistant",
        (", -0.0004]", "]"),
        "cameras[0].distortion_coefficients: [0.01, -0.02, 0.003] given",
    ),
    ("py-OCamCalib, size from the caller", ("0.000175, 1.0", "0.000175, 2.0"), "stretch_matrix[1]: 2 given"),
    ("py-OCamCalib, size from the caller", ("338.0, 0.0", "NaN, 0.0"), "taylor_coefficient"),
    (
        "ORB-SLAM3, the first of a stereo fisheye",
        ("Camera1.fx: 311.0", "Camera1.fx: 0"),
        "Camera1.fx: 0 given",
    ),
    ("ROS message", ("binning_x: 0", "binning_x: 2"), "binning_x: a binned image"),
    ("ROS message", ("x_offset: 0", "x_offset: 8"), "roi.x_offset: a part of the sensor"),
    ("ROS message", ("height: 0, width: 0", "height: 0, width: 320"), "roi.width: a part of the sensor"),
    ("OCamCalib", ("5 -1.53", "6 -1.53"), "line 3: rows[0]: a polynomial of 6 numbers, but 5 follow"),
    ("OCamCalib", ("382.5 456.25", "382.5"), "line 11: rows[2]: [382.5] given; a list of 2 numbers"),
    ("OCamCalib", ("768 1024", ""), "rows[4]: missing; needed: image size: height and width"),
    ("OCamCalib", ("768 1024", "768 1e999"), "[1]inf given"),
    ("OCamCalib", ("-1.535000e+02", "1.535000e+02"), "a0 = 153.5 given; legal: below 0"),
    ("SVO omni", ("rows: 24", "rows: 23"), "24 numbers given; 23 x 1 are needed"),
    (
        "SVO omni",
        ("type: omni", "type: atan"),
        "cameras[0].camera.type: 'atan' given; legal: 'omni', 'pinhole'",
    ),
    (
        "BoofCV universal",
        ("mirror_offset: 1.125", "mirror_offset: -2"),
        "mirror_offset: -2 given; legal: >= 0",
    ),
    ("BoofCV universal", ("- 0.06", "- 0.06\n  - 0.1"), "radial_tangential.radial: 3 numbers given"),
    ("BoofCV Kannala-Brandt", ("- 0.0\n", "- 0.5\n"), "tangent: asymmetric distortion"),
    (
        "COLMAP PINHOLE",
        ("2 PINHOLE 640 480 611", "2 PINHOLE 640 480"),
        "camera 2: 5 numbers after PINHOLE; needed",
    ),
    ("COLMAP PINHOLE", ("640 480 611 612", "640 480 0 612"), "camera 2: a focal length of 0"),
    ("COLMAP PINHOLE", ("2 PINHOLE 640 480", "2 PINHOLE 640.5 480"), "line 4: rows[1]: 640.5 given; a whole"),
    ("Mei toolbox, its arrays", ("-0.002, 0]", "-0.002, 0.1]"), "line 2: kc: a fifth number, 0.1"),
    ("Mei toolbox, its arrays", ("xi: 1.125", "xi: -1.125"), "line 1: xi: -1.125 given; legal: >= 0"),
    (
        "ViSP with distortion",
        ("perspectiveProjWithDistortion", "omni"),
        "line 9: root.camera.model.type: 'omni' given",
    ),
    ("ViSP with distortion", ("<px>611.0</px>", "<px>0</px>"), "line 10: root.camera.model.px: 0 given"),
    ("ViSP with distortion", ("</model>", ""), "line 15: not XML: mismatched tag"),
    ("ROS ost.txt, the caller says fisheye", ("", ""), "say it: --model pinhole or --model fisheye"),
    ("ROS ost.txt", ("\n480", "\n480 481"), "narrow_stereo.height: [480, 481] given; a list of 1 numbers"),
    ("ROS ost.txt of a pair", ("[stereo/left]", "[stereo/right]"), "18 numbers given; the 9 of K are needed"),
    ("ROS fisheye", ("-0.0004]", "-0.0004, 0.0]"), "5 numbers given; 1 x 4 are needed"),
    ("ROS equidistant with a zero more", ("0.0]", "0.1]"), "5 numbers given; legal: k1 to k4, then zeros"),
    ("ROS plumb_bob with eight numbers", (K_DATA, "[0, 0, 0, 0, 0, 0, 0, 0, 0]"), "is not calibrated"),
    ("own, another model", ('"k": [0.01,', '"k": ['), "k: "),
    ("own, another model", ('"kannala_brandt"', '"brown"'), "model: 'brown' given; legal: unified"),
]


@pytest.mark.parametrize(
    ("sample", "change", "message"), CHANGES, ids=lambda x: x if isinstance(x, str) else ""
)
def test_broken_file_says_where_and_what_is_legal(tmp_path, sample, change, message):
    text, options, _ = SAMPLES[sample]
    options = {key: value for key, value in options.items() if key != "model"}
    assert change[0] in text
    assert message in refusal(tmp_path, text.replace(*change, 1) if change[0] else text, **options)


@pytest.mark.parametrize("sample", SAMPLES)
@pytest.mark.parametrize("keep", [0.3, 0.7, 0.9])
def test_truncated_file_is_refused_or_the_same_camera_but_for_what_is_cut(tmp_path, sample, keep):
    text, options, expected = SAMPLES[sample]
    path = tmp_path / "camera.dat"
    path.write_text(text[: int(keep * len(text))])
    try:
        camera = load_model(path, **options)
    except InputError as error:
        assert str(error).startswith((str(path), "model: "))  # noqa: PT017
        assert "\n" not in str(error)  # noqa: PT017
    else:
        assert (camera.width, camera.height) == (expected.width, expected.height)


DOCTYPES = {
    "bomb": '<!DOCTYPE r [<!ENTITY a "xxxx"><!ENTITY b "&a;&a;&a;&a;">]>\n<root>&b;</root>',
    "file": '<!DOCTYPE r [<!ENTITY a SYSTEM "file:///etc/passwd">]>\n<root><camera>&a;</camera></root>',
    "net": '<!DOCTYPE root SYSTEM "http://127.0.0.1/x.dtd">\n<root></root>',
}


@pytest.mark.parametrize("kind", DOCTYPES)
def test_document_types_and_entities_are_refused(tmp_path, kind):
    message = refusal(tmp_path, '<?xml version="1.0"?>\n' + DOCTYPES[kind])
    assert message == "line 2: document types (DOCTYPE) are not read"


def test_undeclared_entity_deep_and_large_xml_are_refused(tmp_path):
    assert "not XML: undefined entity" in refusal(tmp_path, "<root><camera>&a;</camera></root>")
    assert "nested deeper than 100" in refusal(tmp_path, "<a>" * 110 + "</a>" * 110)
    assert "bytes; at most" in refusal(tmp_path, "<root>" + "<a/>" * 2**18 + "</root>")
    assert "no known camera format" in refusal(tmp_path, "<html><body>404</body></html>")


@pytest.mark.parametrize(
    "text",
    [
        "1 2 3",
        "0\n0\n",
        "5\n1 2\n",
        "-1 2\n3",
        "1 1\n1 1\n",
        "1 PINHOLE",
        "1 PINHOLE\n2",
        "<root/>",
        "<root>3</root>",
        "<root><camera/></root>",
        "<root><camera><model/></camera></root>",
        "<root><camera>3</camera><camera/></root>",
        "<opencv_storage/>",
        "<opencv_storage><_>1</_><_>2</_></opencv_storage>",
        "<opencv_storage><K><data>1</data></K></opencv_storage>",
        '{"value0": {"intrinsics": 3}}',
        '{"value0": {"intrinsics": [3]}}',
        '{"value0": {"intrinsics": []}}',
        '{"cameras": [{"camera": 3}]}',
        '{"cameras": [{"camera": {}}, {"camera": {"label": [1]}}]}',
        '{"model": "stereo_camera"}',
        '{"model": "pinhole", "pinhole": 3}',
        '{"model": [1], "pinhole": {}}',
        '{"model": "omnidirectional_universal", "pinhole": {}, "radial_tangential": 3}',
        '{"distortion_model": ["x"], "K": 3}',
        '{"distortion_model": "plumb_bob", "K": [[1], [2], [3]]}',
        '{"distortion_model": null, "k": {"rows": 3}}',
        '{"K": {"data": {"a": 1}, "rows": 1, "cols": 1}}',
        '{"rows": [1, 2]}',
        '{"rows": [[], []]}',
        '{"K": {"data": [true], "rows": 1, "cols": 1}}',
        '{"K": {"data": [1], "rows": 1e300, "cols": 1e300}}',
        '{"model_type": ["MEI"]}',
        '{"xi": 1, "fx": {"a": 1}}',
        '{"xi": 1, "gammac": 3}',
        '{"format": "omniservo.camera/1"}',
        '{"format": "omniservo.camera/1", "model": ["x"]}',
        '{"cam0": null}',
        '{"cam0": {"camera_model": {"a": 1}}}',
        '{"cam0": {"camera_model": "omni", "distortion_model": "none", "intrinsics": "12345"}}',
    ],
)
def test_nonsense_in_a_format_s_clothes_is_one_clear_error(tmp_path, text):
    path = tmp_path / "camera.dat"
    path.write_text(text)
    with pytest.raises(InputError, match=r"camera\.dat") as caught:
        load_model(path)
    assert "\n" not in str(caught.value)


def test_a_large_broken_file_is_refused_and_deep_json_without_a_traceback(tmp_path):
    poses = {"px": [0.25] * 100_000, "fx": 0}
    camera = {"camera_type": "ds", "intrinsics": poses}
    message = refusal(tmp_path, json.dumps({"value0": {"intrinsics": [camera], "resolution": []}}))
    assert message == "value0.intrinsics[0].intrinsics.fx: 0 given; legal: any number but 0"
    deep = '{"cam0": {"camera_model": ' + "[" * 400 + "]" * 400 + "}}"
    assert "cam0.camera_model" in refusal(tmp_path, deep)


@pytest.mark.parametrize("size", [640, (640,), (640, 480, 3), (640.5, 480), ("640", "480"), "640x480"])
def test_a_size_that_is_none_is_named_whatever_the_file_says(tmp_path, size):
    path = tmp_path / "camera.json"
    path.write_text('{"K": [[300, 0, 320], [0, 300, 240], [0, 0, 1]], "D": [0, 0, 0, 0, 0]}')
    with pytest.raises(InputError, match="^size: "):
        load_model(path, size=size)


@pytest.mark.parametrize(
    "fields",
    [
        {"K": K_ROWS, "distortion_parameters": RADTAN},
        {"K": K_ROWS, "k1": -0.2, "k2": 0.05, "p1": 0.001, "p2": -0.002},
        {"K": K_ROWS, "xi": 1.2, "k1": -0.2, "k2": 0.05, "p1": 0.001, "p2": -0.002},
        {"K": K_ROWS, "RadialDistortion": [-0.2, 0.05], "TangentialDistortion": [0.001, -0.002]},
        {"K": K_ROWS, "coefficients": RADTAN},
        {"K1": K_ROWS, "K2": K_ROWS, "D": RADTAN},
        {"K1": K_ROWS, "K2": K_ROWS, "distCoeffs": {"rows": 1, "cols": 5, "data": RADTAN}, "D2": RADTAN},
    ],
)
def test_a_distortion_that_is_not_known_for_one_is_not_left_out(tmp_path, fields):
    path = tmp_path / "camera.json"
    path.write_text(json.dumps({**fields, "image_size": [640, 480]}))
    with pytest.raises(InputError, match="not known as this camera's distortion; legal: "):
        load_model(path, name="1" if "K1" in fields else None)


@pytest.mark.parametrize(
    ("fields", "message"),
    [
        (
            {"xi": 1.1, "fx": 300, "fy": 300, "cx": 320, "cy": 240, "distortion": RADTAN[:4]},
            "not read beside xi",
        ),
        (
            {
                "type": "pinhole",
                "intrinsics": [300, 300, 320, 240],
                "image_width": 640,
                "image_height": 480,
                "distortion": RADTAN[:4],
            },
            "distortion: .* a mapping with type is needed",
        ),
    ],
    ids=["Mei", "SVO"],
)
def test_a_distortion_in_another_form_is_refused(tmp_path, fields, message):
    path = tmp_path / "camera.json"
    path.write_text(json.dumps(fields))
    with pytest.raises(InputError, match=message):
        load_model(path, size=(640, 480))


def test_the_name_that_is_usual_in_python_is_known(tmp_path):
    """It was left out, and the camera had no distortion."""
    path = tmp_path / "camera.yaml"
    path.write_text(yaml.safe_dump({"camera_matrix": K_ROWS, "dist_coeff": [RADTAN]}))
    assert load_model(path, size=(640, 480)).distortion == tuple(RADTAN)


@pytest.mark.parametrize(
    "text",
    ['Intrinsic of "a"' + 200_000 * " " + "x", 200_000 * "1" + "x", "<a><b>" + 200_000 * "1" + "x</b></a>"],
    ids=["RealSense", "table", "XML"],
)
def test_no_pattern_takes_long_over_what_almost_fits(tmp_path, text):
    """Each took time with the square of the length: minutes here, hours with the megabyte that is read."""
    path = tmp_path / "camera"
    path.write_text(text)
    begin = time.process_time()
    with pytest.raises(InputError):
        load_model(path)
    assert time.process_time() - begin < 5.0


def test_numbers_of_tables_and_xml_are_plain_decimal_numbers(tmp_path):
    text, _, _ = SAMPLES["COLMAP PINHOLE"]
    for number in ("6_11", "\u0666", "0x1p3", "+-3"):
        assert "a number is needed" in refusal(tmp_path, text.replace("612", number), name="2")


def test_size_that_differs_from_the_file_s_is_refused_and_an_equal_one_accepted(tmp_path):
    for sample, (text, options, expected) in SAMPLES.items():
        if "size" in options:
            message = refusal(tmp_path, text, **{**options, "size": None})
            assert "does not say the image size; say it: --size" in message, sample
            continue
        given = {**options, "size": (expected.width, expected.height)}
        (tmp_path / "good.dat").write_text(text)
        assert load_model(tmp_path / "good.dat", **given).width == expected.width
        message = refusal(tmp_path, text, **{**options, "size": (752, 481)})
        assert f"has {expected.width}x{expected.height} pixels; 752x481 was asked for" in message, sample


def test_model_is_asked_for_only_where_the_file_leaves_it_open(tmp_path):
    text, _, expected = SAMPLES["OpenCV, four numbers, the caller says pinhole"]
    path = tmp_path / "camera.dat"
    path.write_text(text)
    fisheye = load_model(path, model="fisheye")
    assert isinstance(fisheye, KannalaBrandt)
    assert fisheye.k == expected.distortion
    with pytest.raises(InputError, match="model: 'kb' given; legal: pinhole, fisheye"):
        load_model(path, model="kb")
    path.write_text(SAMPLES["Kalibr ds"][0])
    with pytest.raises(InputError, match="says its model itself"):
        load_model(path, model="pinhole")
    told, _, _ = SAMPLES["OpenCV pinhole, fisheye_model 0"]
    assert "the file says pinhole; fisheye was asked for" in refusal(tmp_path, told, model="fisheye")
    omnidir, _, _ = SAMPLES["OpenCV omnidir, XML, xi a number"]
    assert "the file says omnidir (xi); fisheye was asked for" in refusal(tmp_path, omnidir, model="fisheye")
    text, _, _ = SAMPLES["OpenCV pinhole, five"]
    assert "5 numbers given; legal counts: 4" in refusal(tmp_path, text, model="fisheye")


def test_a_fisheye_whose_numbers_are_missing_is_no_pinhole(tmp_path):
    fields = {"K": [[311, 0, 320], [0, 312, 240], [0, 0, 1]], "image_size": [640, 480]}
    words = "distortion_coefficients: missing; a fisheye's k1 k2 k3 k4 are needed"
    assert words in refusal(tmp_path, json.dumps({**fields, "camera_model": "fisheye"}))
    assert words in refusal(tmp_path, json.dumps(fields), model="fisheye")
    assert isinstance(load_model(tmp_path / "camera.dat"), Pinhole)


def test_skew_is_refused_by_formats_without_a_place_for_it(tmp_path):
    skewed = KannalaBrandt(300.0, 300.0, 320.0, 240.0, 640, 480, k=(0.0,) * 4, skew=1.0)
    for format_name in ("colmap", "visp", "ros", "basalt", "kalibr", "camodocal", "opencv"):
        with pytest.raises(InputError, match="cannot hold skew"):
            save_camera(skewed, tmp_path / "out", format_name)
    assert not any(tmp_path.iterdir())


@pytest.mark.parametrize("lens", [{"xi": 0.5}, {"deviation_px": -0.5}, {"deviation_px": 1e10}, 3])
def test_a_lens_field_that_is_none_or_not_legal_is_refused(tmp_path, lens):
    fields = json.loads(SAMPLES["OpenCV fisheye, said by distortion_model in JSON"][0])
    fields["omniservo_lens"] = lens
    assert any(word in refusal(tmp_path, json.dumps(fields)) for word in ("omniservo_lens", "deviation_px: "))


def test_a_covariance_of_the_unified_cameras_parameters_is_no_other_cameras(tmp_path):
    fields = json.loads(SAMPLES["OpenCV fisheye, said by distortion_model in JSON"][0])
    fields["omniservo_lens"] = {"calibration_covariance": np.eye(5).tolist()}
    assert "omniservo_lens: calibration_covariance given" in refusal(tmp_path, json.dumps(fields))


NONSENSE = (
    None,
    True,
    "x",
    "",
    [],
    {},
    [1],
    {"a": 1},
    -1,
    0,
    1e308,
    float("nan"),
    float("inf"),
    [[1], 2],
    10**40,
)


def places(value, path=()):
    """The paths of everything inside mappings and lists."""
    inner = value.items() if isinstance(value, dict) else enumerate(value) if isinstance(value, list) else ()
    for key, held in inner:
        yield (*path, key)
        yield from places(held, (*path, key))


@pytest.mark.slow
def test_nonsense_in_any_field_is_an_error_or_a_camera_and_never_a_traceback(tmp_path):
    rng = np.random.default_rng(11)
    path = tmp_path / "camera.dat"
    refused = 0
    for text, options, _ in SAMPLES.values():
        if text.lstrip().startswith(("<", "#", "Device")) or "'imagersize'" in text:
            continue
        plain = text.replace("%YAML:1.0\n", "").replace("!!opencv-matrix", "").removesuffix("---\n")
        for _ in range(4):
            fields = yaml.safe_load(plain)
            found = list(places(fields))
            *outer, last = found[rng.integers(len(found))]
            holder = fields
            for step in outer:
                holder = holder[step]
            holder[last] = NONSENSE[rng.integers(len(NONSENSE))]
            path.write_text(json.dumps(fields))
            try:
                load_model(path, **options)
            except InputError as error:
                assert "\n" not in str(error)  # noqa: PT017
                refused += 1
    assert refused > 60
