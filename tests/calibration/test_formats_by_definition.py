"""Formats whose numbers are not our models' own, beside their makers' formulas; and binary ones."""

import json
import math
import struct

import numpy as np
import pytest
from tests.calibration.format_samples import DEPTHAI, METASHAPE, NERF, RATIONAL, REALSENSE, mrcal

from omniservo.camera_files import load_model
from omniservo.cameras.models import Pinhole
from omniservo.errors import InputError

POINTS = np.random.default_rng(5).uniform([-0.5, -0.4, 0.8], [0.5, 0.4, 1.2], (200, 3))

WOODSCAPE = {
    "extrinsic": {"quaternion": [0.5, -0.5, 0.5, -0.5], "translation": [3.7, 0.0, 0.7]},
    "intrinsic": {
        "aspect_ratio": 1.01,
        "cx_offset": 4.0,
        "cy_offset": -3.0,
        "width": 1280.0,
        "height": 966.0,
        "k1": 340.0,
        "k2": -32.0,
        "k3": 48.0,
        "k4": -7.2,
        "model": "radial_poly",
        "poly_order": 4,
    },
    "name": "FV",
}


def written(tmp_path, content):
    path = tmp_path / "camera.dat"
    path.write_bytes(content if isinstance(content, bytes) else content.encode())
    return path


def test_woodscapes_polynomial_is_met_within_what_the_camera_says_it_is_off(tmp_path):
    camera = load_model(written(tmp_path, json.dumps(WOODSCAPE)))
    theta, around = np.meshgrid(np.linspace(0.01, camera.max_angle, 150), np.linspace(0.0, 6.2, 12))
    across = np.stack([np.cos(around), np.sin(around)], axis=-1)
    points = np.concatenate([np.sin(theta)[..., None] * across, np.cos(theta)[..., None]], axis=-1)
    radius = 340.0 * theta - 32.0 * theta**2 + 48.0 * theta**3 - 7.2 * theta**4
    theirs = np.stack([radius * np.cos(around) + 643.5, 1.01 * radius * np.sin(around) + 479.5], axis=-1)
    ours, valid = camera.project(points.reshape(-1, 3))
    assert valid.all()
    off = np.linalg.norm(ours - theirs.reshape(-1, 2), axis=1)
    assert off.max() <= camera.deviation_px * (1.0 + 1e-6)
    assert 0.0 < camera.deviation_px < 1.0
    assert np.degrees(camera.max_angle) > 90.0


@pytest.mark.parametrize(("field", "value", "message"), [
    ("model", "cylindrical", "intrinsic.model: 'cylindrical' given; legal: 'radial_poly'"),
    ("k1", -340.0, "the radius does not grow with the angle"),
    ("aspect_ratio", 0.0, "intrinsic.aspect_ratio: "),
    ("width", 0.5, "intrinsic.width: "),
])  # fmt: skip
def test_a_woodscape_file_that_is_no_camera_is_refused(tmp_path, field, value, message):
    broken = {**WOODSCAPE, "intrinsic": {**WOODSCAPE["intrinsic"], field: value}}
    with pytest.raises(InputError, match=message):
        load_model(written(tmp_path, json.dumps(broken)))


def test_metashapes_frame_camera_projects_as_its_manual_says(tmp_path):
    skewed = METASHAPE.replace("<b1>-1</b1>", "<b1>-1</b1><b2>0.5</b2>")
    camera = load_model(written(tmp_path, skewed), name="frame")
    x, y = POINTS[:, 0] / POINTS[:, 2], POINTS[:, 1] / POINTS[:, 2]
    r2 = x * x + y * y
    radial, p1, p2 = 1.0 - 0.3 * r2 + 0.1 * r2**2 + 0.02 * r2**3, -0.002, 0.001
    bent_x = x * radial + p1 * (r2 + 2.0 * x * x) + 2.0 * p2 * x * y
    bent_y = y * radial + p2 * (r2 + 2.0 * y * y) + 2.0 * p1 * x * y
    u = 320.0 + 0.75 + bent_x * (612.0 - 1.0) + bent_y * 0.5
    v = 240.0 + bent_y * 612.0
    ours, valid = camera.project(POINTS)
    np.testing.assert_allclose(ours[valid] + 0.5, np.column_stack([u, v])[valid], atol=1e-9)
    assert valid.sum() > 100


@pytest.mark.parametrize(("change", "message"), [
    (("<k3>0.02</k3>", "<k4>0.1</k4>"), "calibration[1].k4: 0.1 given; legal of a frame camera: 0"),
    (("<p1>", "<p3>0.5</p3><p1>"), "calibration[1].p3: 0.5 given; legal of a frame camera: 0"),
    (("<p1>", "<p4>-3</p4><p1>"), "calibration[1].p4: -3 given; legal of a frame camera: 0"),
    (("<f>612</f>", "<f>0</f>"), "0 given; legal: any number but 0"),
    (('calibration type="frame" class="adj', 'calibration type="spherical" class="adj'), "'spherical' given"),
])  # fmt: skip
def test_what_of_metashape_no_model_has_is_refused(tmp_path, change, message):
    assert change[0] in METASHAPE
    with pytest.raises(InputError) as raised:
        load_model(written(tmp_path, METASHAPE.replace(*change, 1)), name="frame")
    assert message in str(raised.value)


def test_sensors_of_metashape_with_one_label_are_two_cameras(tmp_path):
    """Two lenses of one kind, or two chunks: the second was taken for the first."""
    path = written(tmp_path, METASHAPE.replace('label="wide"', 'label="frame"'))
    with pytest.raises(InputError, match=r"2 cameras; say which.*frame, frame \(2\)"):
        load_model(path)
    assert load_model(path, name="frame").fy == 612.0
    assert load_model(path, name="frame (2)").fy == 312.0


def cameras_bin(*cameras):
    """COLMAP's own layout: count, then id, model, width, height and parameters, little-endian."""
    return struct.pack("<Q", len(cameras)) + b"".join(
        struct.pack("<IiQQ", number, model, 640, 480) + struct.pack(f"<{len(values)}d", *values)
        for number, model, values in cameras
    )


def test_colmaps_binary_cameras_are_those_of_the_text(tmp_path):
    content = cameras_bin((3, 1, (611.0, 612.0, 320.75, 240.0)), (7, 7, (1.0, 2.0, 3.0, 4.0, 0.5)))
    camera = load_model(written(tmp_path, content), name="3")
    assert (camera.fx, camera.fy, camera.cx, camera.cy) == (611.0, 612.0, 320.25, 239.5)
    with pytest.raises(InputError, match="camera 7: 'FOV' given; legal: SIMPLE_PINHOLE"):
        load_model(written(tmp_path, content), name="7")
    newer = cameras_bin(
        (1, 11, (1.0,) * 16), (2, 13, (1.0,) * 5), (3, 16, (191.0, 192.0, 3.0, 4.0, 0.6, 1.1))
    )
    assert load_model(written(tmp_path, newer), name="3").beta == 1.1
    fisheyes = cameras_bin((1, 12, (1.0,) * 4), (2, 14, (191.0, 3.0, 4.0)), (3, 15, (191.0, 192.0, 3.0, 4.0)))
    assert load_model(written(tmp_path, fisheyes), name="2").fy == 191.0
    assert load_model(written(tmp_path, fisheyes), name="3").fy == 192.0
    newer = cameras_bin((1, 11, (1.0,) * 16))
    with pytest.raises(InputError, match="camera 1: 'RAD_TAN_THIN_PRISM_FISHEYE' given"):
        load_model(written(tmp_path, newer), name="1")
    for cut in (9, len(content) - 1):
        with pytest.raises(InputError, match=r"neither text \(UTF-8\) nor a cameras.bin of COLMAP"):
            load_model(written(tmp_path, content[:cut]))
    with pytest.raises(InputError, match="neither text"):
        load_model(written(tmp_path, struct.pack("<Q", 2**60)))


def test_transforms_with_a_camera_for_each_frame_or_a_fourth_coefficient_are_refused(tmp_path):
    of_each = {"w": 640, "h": 480, "frames": [{"fl_x": 611.0}]}
    with pytest.raises(InputError, match="fl_x: missing; a camera for all frames is read"):
        load_model(written(tmp_path, json.dumps(of_each)))
    with pytest.raises(InputError, match="k4: 0.1 given; legal with this camera_model: 0"):
        load_model(written(tmp_path, json.dumps({**NERF, "k4": 0.1})))


def test_transforms_have_an_angle_for_each_axis(tmp_path):
    """fy was taken from the horizontal angle, whatever the vertical one said."""
    angles = {
        "w": 640,
        "h": 480,
        "camera_angle_x": 2.0 * math.atan(0.5),
        "camera_angle_y": 2.0 * math.atan(0.4),
    }
    camera = load_model(written(tmp_path, json.dumps({**angles, "frames": []})))
    assert (camera.fx, camera.fy) == pytest.approx((640.0, 600.0))
    with pytest.raises(InputError, match="camera_angle_y: 4 given; legal: more than 0 and less than pi"):
        load_model(written(tmp_path, json.dumps({**angles, "camera_angle_y": 4.0})))


@pytest.mark.parametrize("lens", [{"ftheta_p0": 0.0, "ftheta_p1": 1e-3}, {"latlong": True}])
def test_transforms_of_another_lens_are_no_pinhole(tmp_path, lens):
    with pytest.raises(InputError, match="a lens that no model of ours has"):
        load_model(written(tmp_path, json.dumps({**NERF, **lens})))


def test_realsense_coefficients_of_no_distortion_are_not_used(tmp_path):
    camera = load_model(
        written(tmp_path, REALSENSE.replace("Inverse Brown Conrady", "None")), name="Color-640x480"
    )
    assert camera.to_dict() == Pinhole(611.0, 612.0, 320.25, 239.5, 640, 480).to_dict()


def test_a_realsense_stream_that_is_printed_twice_with_other_numbers_is_refused(tmp_path):
    """Of two cameras, or of formats that are rectified and not: the last one was taken."""
    twice = REALSENSE + REALSENSE.replace("312", "313")
    with pytest.raises(InputError, match=r"Fisheye 1-640x480: printed several times with other numbers"):
        load_model(written(tmp_path, twice), name="Fisheye 1-640x480")
    assert load_model(written(tmp_path, twice), name="Color-640x480").fy == 612.0


def test_a_depthai_fisheye_with_more_than_four_numbers_is_refused_unless_the_rest_are_zeros(tmp_path):
    fields = json.loads(DEPTHAI)
    stated = fields["cameraData"][1][1]["distortionCoeff"]
    stated[4:] = [0.5] + 9 * [0.0]
    with pytest.raises(InputError, match=r"distortionCoeff: 14 numbers given; legal: k1 to k4, then zeros"):
        load_model(written(tmp_path, json.dumps(fields)), name="2")
    stated[4] = 0.0
    assert list(load_model(written(tmp_path, json.dumps(fields)), name="2").k) == stated[:4]


@pytest.mark.parametrize(
    ("text", "words"),
    [
        (
            mrcal("LENSMODEL_CAHVOR", RATIONAL.distortion),
            "lensmodel: 'LENSMODEL_CAHVOR' given; legal: 'LENSMODEL_",
        ),
        (mrcal("LENSMODEL_OPENCV8", (0.1, 0.2)), "a list of 12 numbers is needed"),
        (mrcal("LENSMODEL_OPENCV4", (0.1, 0.2, 0.0, "x")), r"intrinsics: \[7\]"),
        (mrcal("LENSMODEL_PINHOLE", ()).replace("'imagersize'", "'size'"), "imagersize: missing"),
        (mrcal("LENSMODEL_PINHOLE", ()).replace("611.0", "nan"), r"intrinsics: \[0\]"),
        (mrcal("LENSMODEL_PINHOLE", ()).replace("612.0", "0.0"), r"intrinsics: \[1\]0 given"),
    ],
)
def test_a_camera_model_of_mrcal_that_is_not_read_is_refused_by_its_field(tmp_path, text, words):
    path = tmp_path / "camera.cameramodel"
    path.write_text(text)
    with pytest.raises(InputError, match=words):
        load_model(path)
