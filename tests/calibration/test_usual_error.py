"""The model error of cameras from files: stated there, by the caller, or the usual one; never none."""

import json

import cv2
import numpy as np
import pytest
from typer.testing import CliRunner

from omniservo.camera_files import closest_model, load_camera, load_model, named_camera, save_camera
from omniservo.cameras import ModelError, UnifiedCamera
from omniservo.cameras.conversion import to_unified
from omniservo.cameras.models import KannalaBrandt
from omniservo.cli.main import app
from omniservo.errors import InputError

PLAIN = UnifiedCamera(300.0, 300.0, 500.0, 400.0, 1.2, 1000, 800)
STATED = UnifiedCamera(300.0, 300.0, 500.0, 400.0, 1.2, 1000, 800, model_error=ModelError(0.21, 130.0))
FORMATS = ("own", "mei", "camodocal", "kalibr")


def test_a_camera_read_from_a_file_has_the_usual_error(tmp_path):
    save_camera(PLAIN, tmp_path / "plain.yaml")
    assert load_model(tmp_path / "plain.yaml").model_error is None
    assert load_camera(tmp_path / "plain.yaml").model_error == ModelError(0.6, 100.0)
    bent = UnifiedCamera.from_dict({**PLAIN.to_dict(), "distortion": [0.01, 0.0, 0.0, 0.0]})
    save_camera(bent, tmp_path / "bent.yaml")
    assert load_camera(tmp_path / "bent.yaml").model_error.sigma_px == pytest.approx(0.3)


@pytest.mark.parametrize("format_name", FORMATS)
def test_a_stated_error_is_saved_and_loaded(tmp_path, format_name):
    path = tmp_path / "camera.yaml"
    save_camera(STATED, path, format_name)
    assert load_model(path) == STATED
    assert load_camera(path) == STATED
    assert load_camera(path, camera_error=0.5).model_error == ModelError(0.5, 100.0)


@pytest.mark.parametrize("name", ["RMS", "rmse", "reprojection_error"])
def test_an_rms_by_another_name_does_too(tmp_path, name):
    fields = {"camera_matrix": [[500, 0, 320], [0, 500, 240], [0, 0, 1]], "dist_coeffs": [0.1, 0, 0, 0, 0]}
    (tmp_path / "cv.json").write_text(json.dumps({**fields, "width": 640, "height": 480, name: 0.4}))
    assert load_camera(tmp_path / "cv.json").model_error.sigma_px == pytest.approx(0.52)


@pytest.mark.parametrize("order", [(0.4, 0.2), (0.2, 0.4)])
def test_of_several_the_largest_counts_in_any_order(tmp_path, order):
    fields = {"camera_matrix": [[500, 0, 320], [0, 500, 240], [0, 0, 1]], "dist_coeffs": [0.1, 0, 0, 0, 0]}
    stated = dict(zip(("rms", "reprojection_error"), order, strict=True))
    (tmp_path / "cv.json").write_text(json.dumps({**fields, "width": 640, "height": 480, **stated}))
    assert load_camera(tmp_path / "cv.json").model_error.sigma_px == pytest.approx(0.52)


def test_an_rms_in_the_file_sets_the_usual_error(tmp_path):
    text = (
        "%YAML:1.0\n---\nimage_width: 640\nimage_height: 480\ncamera_matrix: !!opencv-matrix\n   rows: 3\n"
        "   cols: 3\n   dt: d\n   data: [ 500., 0., 320., 0., 500., 240., 0., 0., 1. ]\n"
        "distortion_coefficients: !!opencv-matrix\n   rows: 5\n   cols: 1\n   dt: d\n"
        "   data: [ 0.1, 0., 0., 0., 0. ]\navg_reprojection_error: 0.4\n"
    )
    (tmp_path / "cv.yml").write_text(text)
    assert load_camera(tmp_path / "cv.yml").model_error.sigma_px == pytest.approx(0.52)
    storage = cv2.FileStorage(str(tmp_path / "cv.xml"), cv2.FILE_STORAGE_WRITE)
    for field in ("image_width", 640), ("image_height", 480), ("avg_reprojection_error", 0.4):
        storage.write(*field)
    storage.write("camera_matrix", np.array([[500.0, 0.0, 320.0], [0.0, 500.0, 240.0], [0.0, 0.0, 1.0]]))
    storage.write("distortion_coefficients", np.array([0.1, 0.0, 0.0, 0.0, 0.0]))
    storage.release()
    assert load_camera(tmp_path / "cv.xml").model_error.sigma_px == pytest.approx(0.52)


def test_a_preset_is_exact_unless_an_error_is_given():
    assert named_camera("fe185").model_error is None
    given = named_camera("fe185", camera_error=0.3).model_error
    assert given.sigma_px == 0.3


def test_what_a_conversion_leaves_is_added_in_quadrature():
    lens = KannalaBrandt(
        fx=250.0, fy=250.0, cx=320.0, cy=240.0, width=640, height=480, max_angle=1.2,
        k=(0.05, -0.03, 0.01, 0.0), model_error=ModelError(0.2, 64.0),
    )  # fmt: skip
    found = to_unified(lens, largest_px=10.0)
    assert found.residual.rms_px > 0.01
    expected = np.hypot(0.2, found.residual.rms_px / np.sqrt(2.0))
    assert found.camera.model_error.sigma_px == pytest.approx(expected)
    assert found.camera.model_error.length_px == 64.0
    assert closest_model(found.camera, "mei")[0].model_error == found.camera.model_error


@pytest.mark.parametrize(
    ("value", "words"),
    [
        ({"sigma_px": -1.0, "length_px": 9.0}, "model_error.sigma_px: -1 given"),
        ({"sigma_px": 1.0, "length_px": 0.0}, "model_error.length_px: 0 given"),
        ({"sigma_px": 1.0}, "model_error: "),
        (0.3, "model_error: 0.3 given"),
    ],
)
def test_an_illegal_error_is_refused_with_its_field(value, words):
    with pytest.raises(InputError, match=words):
        UnifiedCamera.from_dict({**PLAIN.to_dict(), "model_error": value})


def test_commands_show_the_error_and_take_another(tmp_path):
    save_camera(PLAIN, tmp_path / "camera.yaml")
    run = CliRunner().invoke
    shown = json.loads(run(app, ["camera", "show", str(tmp_path / "camera.yaml"), "--json"]).output)
    assert shown["model_error"] == {"sigma_px": 0.6, "length_px": 100.0}
    other = ["camera", "show", str(tmp_path / "camera.yaml"), "--camera-error", "0.3", "--json"]
    assert json.loads(run(app, other).output)["model_error"]["sigma_px"] == 0.3
    out = tmp_path / "converted.yaml"
    given = ["camera", "convert", str(tmp_path / "camera.yaml"), str(out), "--to", "own"]
    assert run(app, [*given, "--camera-error", "0.25"]).exit_code == 0
    assert load_model(out).model_error.sigma_px == 0.25
    wrong = run(app, ["camera", "show", "fe185", "--camera-error", "-1"])
    assert wrong.exit_code != 0
